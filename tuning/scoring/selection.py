"""Which trial is the best, and what it is worth: chosen in scenarios of their own, scored in others never seen.

The start is judged beside the finalists: gains that are no better than those the search started from are never the
best.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dualwinch.simulation.analysis.required_force import within_authority
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.problem import HELD_OUT, SELECTION, Problem
from dualwinch.tuning.progress import CHOOSING, SCORING, SILENT, Watch
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.plan import FULL, Plan
from dualwinch.tuning.scoring.ranking import beats, best_first, pareto_front
from dualwinch.tuning.scoring.scenarios import CHOSEN_SHORTFALL, choosable, vertices
from dualwinch.tuning.scoring.verdict import Score, Verdict

RUNG = 1.08
"""How much larger the objective of a finalist is than that of the one before, where they were tuned."""

NOT_CHOSEN = "no trial is better than the gains that the search started from"
NOT_HELD_OUT = "trial {number} was better than the start where it was chosen, but not in the held-out scenarios"
"""Why the start is kept."""


def judge(evaluator: Evaluator, trials: Sequence[Evaluation], plan: Plan = FULL, watch: Watch = SILENT) -> Verdict:
    """Choose the best trial and score it.

    Keeping to a constraint in a few scenarios is a promise, so that trial is chosen that is best in more of them. It
    has to be better than the start (`beats`) where it is chosen and where it is scored.

    Args:
        evaluator: of the problem.
        trials: finished trials, at least one.
        plan: how many finalists meet in how many scenarios.
        watch: told of both phases.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    problem = evaluator.prepared.problem
    watch.phase(CHOOSING)
    start = _start(evaluator, trials)
    if problem.ensemble is None:
        leader = trials[best_first(trials)[0]]
        best, selection = leader if beats(leader, start) else start, None
    else:
        best, selection = _finals(evaluator, trials, start, plan)
        selection = replace(selection, number=best.number)
    watch.phase(SCORING)
    scenarios = problem.drawn(plan.held_out, problem.seed + HELD_OUT)
    scores = _scores(evaluator, best, start, scenarios, plan)
    obstacle = NOT_CHOSEN if best.point == start.point else ""
    if not obstacle and not beats(scores["best"].evaluation, scores["start"].evaluation):
        obstacle = NOT_HELD_OUT.format(number=best.number)
        best, selection, scores = start, None, scores | {"best": scores["start"]}
    held = [within_authority(each.experiment if isinstance(each, Scenario) else each) for each in scenarios]
    return Verdict(best, obstacle, selection, scores, problem.ensemble is not None, np.array(held), plan)


def _start(evaluator: Evaluator, trials: Sequence[Evaluation]) -> Evaluation:
    """The start as it was tuned: the trial that is it, else what preparing has found out."""
    point = evaluator.prepared.problem.start
    return next((trial for trial in trials if trial.point == point and not trial.pruned), None) or evaluator.start()


def _scores(
    evaluator: Evaluator,
    best: Evaluation,
    start: Evaluation,
    scenarios: Sequence[Experiment | Scenario],
    plan: Plan,
) -> dict[str, Score]:
    """The best, the start and the paper's controller in the same scenarios."""
    problem = evaluator.prepared.problem

    def scored(candidate: Candidate) -> Score:
        result = evaluator.run([candidate], scenarios)
        return Score(evaluator.judged(candidate, result, scenarios), result)

    ours = scored(best.candidate)
    theirs = ours if best.point == start.point else scored(start.candidate)
    drawn = problem.drawn(plan.held_out, problem.seed + HELD_OUT, problem.paper_experiment)
    result = evaluator.run(None, drawn)
    paper = Score(evaluator.judged(Candidate({}, "paper"), result, drawn), result)
    return {"best": ours, "start": theirs, "paper": paper}


def _finals(
    evaluator: Evaluator, trials: Sequence[Evaluation], start: Evaluation, plan: Plan
) -> tuple[Evaluation, Evaluation]:
    """The best as it was tuned, and what it came to in the selection scenarios.

    The very best where tuned are often the ones that only just hold: so the finalists are a ladder from the best to
    ever more cautious ones. The best of these among other draws and vertices of the ensemble meet once more, in draws;
    the start is there both times.
    """
    finalists = [trial for trial in _finalists(evaluator.prepared.problem, trials, plan) if trial.point != start.point]
    finalists.append(start)
    first, last = _scenarios(evaluator.prepared.problem, plan)
    met = evaluator.over([trial.candidate for trial in finalists], first)
    left = [index for index in best_first(met) if finalists[index] is not start][: plan.last]
    left.append(len(finalists) - 1)
    again = evaluator.over([finalists[index].candidate for index in left], last)
    better = [row for row in best_first(again) if beats(again[row], again[-1])]
    row = better[0] if better else len(left) - 1
    return finalists[left[row]], again[row]


def _finalists(problem: Problem, trials: Sequence[Evaluation], plan: Plan) -> list[Evaluation]:
    whole = [trials[index] for index in best_first(trials) if not trials[index].pruned]
    if len(problem.objectives) == 1:
        return [whole[index] for index in rungs(whole, plan.finalists)]
    front = [trials[index] for index in pareto_front(trials)] or whole
    return front[:: -(-len(front) // plan.finalists)]


def _scenarios(problem: Problem, plan: Plan) -> tuple[list[Scenario], list[Scenario]]:
    """Scenarios to choose in, of both rounds: draws (`choosable`), to the first of which vertices come."""
    if problem.ensemble is None:
        raise ValueError("only an ensemble has scenarios to choose in")
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    seed = problem.seed + SELECTION
    picks = vertices(ensemble, plan.vertices, seed, furthest=CHOSEN_SHORTFALL, looked_at=plan.looked_at)
    draws = list(ensemble.scenarios(plan.draws + plan.last_draws, seed))
    first = [*choosable(draws[: plan.draws]), *(chosen.drawn(ensemble, seed) for chosen in picks)]
    return first, choosable(draws[plan.draws :])


def rungs(ordered: Sequence[Evaluation], most: int) -> list[int]:
    """Indices of trials, the best first, each with an objective `RUNG` times that of the one before, or the next.

    Args:
        ordered: trials, the best first.
        most: number of indices, at most.
    """
    found = [0]
    for index, trial in enumerate(ordered):
        if len(found) == most:
            break
        above = ordered[found[-1]]
        if trial.feasible != above.feasible or trial.objectives[0] > RUNG * above.objectives[0]:
            found.append(index)
    rest = [index for index in range(len(ordered)) if index not in found]
    return sorted(found + rest[: most - len(found)])
