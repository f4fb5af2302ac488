"""Which trial is the best, and what it is worth: chosen in scenarios of their own, scored in others never seen.

The start is judged beside the finalists: gains that are no better than those the search started from are never the
best.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dualwinch.simulation.analysis.authority import within_authority
from dualwinch.simulation.batch.scenarios import experiment_of
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import HELD_OUT, MARGIN
from dualwinch.tuning.scoring.config import FULL, SampleSizes
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import CHOOSING, SCORING, SILENT, TuningProgress
from dualwinch.tuning.scoring.ranking import (
    Evaluation,
    backed_off_first,
    best_first,
    improves_on,
    pareto_front,
    penalised_first,
)
from dualwinch.tuning.scoring.repair import repaired_after_further_draws, screened
from dualwinch.tuning.scoring.test_set import SelectionResult, TestSet
from dualwinch.tuning.scoring.validation import (
    FeasibilityScreen,
    Validated,
    further_draws,
    strata,
    validated,
    validation_sets,
)

RANGE = 3.0
"""How many times the objective of the most promising trial, where tuned, one that holds may have.

That is how far finalists reach. Where none does, the best is chosen without scenarios that overwhelm the motors.
"""

KEPT = MARGIN / 2
"""Distance from a bound, as a share, up to which more of it makes up for a larger objective: half of what is asked for
where gains are tuned, for here the worst is that of many more scenarios."""

NOT_CHOSEN = "no trial is better than the gains that the search started from"
NOT_HELD_OUT = "{trials} better than the start where chosen, but not in the held-out scenarios"
"""Why the start is kept."""


def judge(
    evaluator: Evaluator, trials: Sequence[Evaluation], plan: SampleSizes = FULL, watch: TuningProgress = SILENT
) -> SelectionResult:
    """Choose the best trial and score it.

    Keeping to a constraint in a few scenarios is a promise, so that trial is chosen that is best in more of them. It
    has to be better than the start (`improves_on`) where it is chosen and where it is scored; one that is not
    where it is scored is passed over for the next, and the verdict says so.

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
        ranking = [(leader, None)] if improves_on(leader, start) else []
    else:
        ranking = _finals(evaluator, trials, start, plan)
    watch.phase(SCORING)
    held_out = TestSet(evaluator, plan.held_out, problem.seed + HELD_OUT)
    scores = {"start": held_out.score(start.candidate), "paper": held_out.paper}
    best, selection, passed_over = start, None, []
    further = further_draws(problem, plan)
    for chosen, selected in ranking:
        trial = repaired_after_further_draws(evaluator, chosen, further)
        score = held_out.score(trial.candidate)
        if improves_on(score.evaluation, scores["start"].evaluation):
            best, selection, scores = trial, selected, scores | {"best": score}
            break
        passed_over.append(trial.number)
    obstacle = "" if "best" in scores else _obstacle(passed_over)
    return SelectionResult(
        best=best,
        obstacle=obstacle,
        passed_over=tuple(passed_over),
        selection=selection,
        scores={"best": scores["start"]} | scores,
        constraints=held_out.constraints,
        held_out=problem.ensemble is not None,
        within_authority=np.array([within_authority(experiment_of(each)) for each in held_out.scenarios]),
        plan=plan,
    )


def _obstacle(passed_over: Sequence[int]) -> str:
    """Why the start is kept."""
    if not passed_over:
        return NOT_CHOSEN
    many = len(passed_over) > 1
    return NOT_HELD_OUT.format(trials=f"{len(passed_over)} trials were" if many else f"trial {passed_over[0]} was")


def _start(evaluator: Evaluator, trials: Sequence[Evaluation]) -> Evaluation:
    """The start as it was tuned: the trial that is it, else what preparing has found out."""
    point = evaluator.prepared.problem.start
    return next((trial for trial in trials if trial.point == point and not trial.pruned), None) or evaluator.start()


def _finals(
    evaluator: Evaluator, trials: Sequence[Evaluation], start: Evaluation, plan: SampleSizes
) -> list[tuple[Evaluation, Evaluation]]:
    """The trials that are better than the start, the best first: as tuned, and what each came to in the last round.

    The soundest of those that hold among other draws and vertices of the ensemble, which are good and keep off their
    bounds (`backed_off_first`), meet once more, in draws; the start is there both times. Behind them come the others,
    by the first round. Those that hold in overwhelming vertices as well are preferred, unless that costs too much.
    """
    first, last, beyond = validation_sets(evaluator.prepared.problem, plan)
    others = [trial for trial in trials if trial.point != start.point]
    ranking = _first_round(evaluator, others, start, [*beyond, *first], plan)
    if beyond and _given_away(others, ranking):
        ranking = _first_round(evaluator, others, start, first, plan)
    again, before = zip(*ranking[: plan.last], strict=True) if ranking else ((), ())
    return _ranked(evaluator, again, start, last, before) + ranking[plan.last :]


def _given_away(trials: Sequence[Evaluation], ranking: Sequence[tuple[Evaluation, Evaluation]]) -> bool:
    """Whether all that hold are far behind the best where tuned (`RANGE`): too much was asked of a short search.

    Several objectives have no best one: there it is whether none holds.
    """
    if trials and len(trials[0].objectives) > 1:
        return not ranking
    best = trials[penalised_first(trials)[0]].objectives[0] if trials else 0.0
    return all(trial.objectives[0] > RANGE * best for trial, _ in ranking)


def _first_round(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    start: Evaluation,
    scenarios: Sequence[Scenario],
    plan: SampleSizes,
) -> list[tuple[Evaluation, Evaluation]]:
    """Trials that are better than the start in some scenarios, the best first, and what each came to there.

    Those that hold there; where none does, the finalist that fails the least is the best.
    """
    problem = evaluator.prepared.problem
    ordered = _worth_trying(trials)
    if not ordered:
        return []
    sieve, before = FeasibilityScreen(evaluator, scenarios), evaluator.rollouts
    held = partial(screened, evaluator, sieve, margin=KEPT)
    if len(problem.objectives) == 1:
        first = [ordered[index] for index in strata(ordered, plan.finalists)]
        met = validated(ordered, first, held, lambda: evaluator.rollouts - before < plan.sieved)
    else:
        front = [trials[index] for index in pareto_front(trials)] or ordered
        first = front[:: -(-len(front) // plan.finalists)]
        met = held(first)
    if not met:
        return _ranked(evaluator, first, start, scenarios)
    (reference,) = evaluator.over([start.candidate], scenarios, constraints=sieve.constraints)
    found = [result for _, result in met]
    return [met[index] for index in backed_off_first(found, KEPT) if improves_on(found[index], reference)]


def _worth_trying(trials: Sequence[Evaluation]) -> list[Evaluation]:
    """Trials that may hold, the best first.

    Where gains are tuned they keep a distance from their bounds, for others are worse than the few scenarios there.
    Here they meet in many more scenarios and have to hold, no more. A search often ends a little nearer to a bound than
    it should: so whoever keeps to all bounds is as good as the others. Where nobody does, all are tried.
    """
    finished = [trials[index] for index in best_first(trials) if not trials[index].pruned]
    near = [trial for trial in finished if trial.violation <= MARGIN]
    if not near or len(near[0].objectives) > 1:
        return finished
    return sorted(near, key=lambda trial: trial.objectives[0])


def _ranked(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    start: Evaluation,
    scenarios: Sequence[Scenario],
    before: Sequence[Evaluation] = (),
) -> list[Validated]:
    """Trials that are better than the start in some scenarios, the best first, and what each came to there.

    Args:
        evaluator: runs them.
        trials: as they were tuned.
        start: is run as well.
        scenarios: where they meet.
        before: what each came to in other scenarios; it is as near to its bounds as it is in either.
    """
    candidates = [trial.candidate for trial in (*trials, start)]
    *met, reference = evaluator.over(candidates, scenarios, constraints=evaluator.bounds(scenarios))
    if before:
        met = [_as_near(result, earlier) for result, earlier in zip(met, before, strict=True)]
    return [(trials[index], met[index]) for index in backed_off_first(met, KEPT) if improves_on(met[index], reference)]


def _as_near(result: Evaluation, earlier: Evaluation) -> Evaluation:
    """A result that is as near to its bounds as an earlier one was, if that was nearer."""
    known = {label: min(value, 0.0) for label, value in earlier.violations.items()}
    nearer = {label: max(value, known.get(label, value)) for label, value in result.violations.items()}
    return replace(result, violations=nearer)
