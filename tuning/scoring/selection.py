"""Which trial is the best, and what it is worth: chosen in scenarios of their own, scored in others never seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.analysis.required_force import within_reach
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.tuning.problem import HELD_OUT, SELECTION, Problem, run_pairs
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.ranking import best_first, pareto_front

FINALISTS, SELECTION_SCENARIOS, SELECTION_CORNERS = 16, 96, 32
"""Finalists, and the draws and corners of the ensemble in which they meet."""

LAST, LAST_SCENARIOS = 4, 192
"""Finalists of the second round, and further scenarios in which they meet."""

RUNG = 1.08
"""How much larger the objective of a finalist is than that of the one before, where they were tuned."""


@dataclass(frozen=True)
class Verdict:
    """The best of a study and its score.

    Attributes:
        best: as it was tuned.
        selection: the best in the selection scenarios; ``None`` without an ensemble.
        held_out: the best in scenarios that neither search nor selection saw; ``None`` without an ensemble.
        held_out_metrics: ``best`` and ``paper`` → figures of merit of every held-out scenario.
        within_reach: (scenarios,) whether the motors can hold it; empty without an ensemble.
        paper: statistics of the paper's gains, by name, in the held-out scenarios, or in the only one there is.
    """

    best: Evaluation
    selection: Evaluation | None
    held_out: Evaluation | None
    held_out_metrics: dict[str, BatchResult]
    within_reach: NDArray[np.bool_]
    paper: dict[str, float]


def rollouts_needed(problem: Problem, held_out: int) -> int:
    """Rollouts that `judge` makes, at most."""
    if not problem.ensemble:
        return 1
    return FINALISTS * (SELECTION_SCENARIOS + SELECTION_CORNERS) + LAST * LAST_SCENARIOS + 2 * held_out


def judge(problem: Problem, trials: Sequence[Evaluation], evaluator: Evaluator, held_out: int) -> Verdict:
    """Choose the best trial and score it.

    Keeping to a constraint in a few scenarios is a promise, so the one is chosen that is best in more of them.

    Args:
        problem: gives scenarios, objectives and constraints.
        trials: finished trials, at least one.
        evaluator: runs them.
        held_out: number of held-out scenarios.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    order = best_first(trials)
    if problem.ensemble is None:
        nothing = np.empty(0, bool)
        return Verdict(trials[order[0]], None, None, {}, nothing, statistics(problem, problem.paper_result))
    best, chosen = _finals(problem, trials, order, evaluator)
    seed = problem.seed + HELD_OUT
    scenarios = problem.drawn(held_out, seed)
    ours = run_pairs(problem.space.keys, [problem.space.parameters(best.point)], scenarios)
    paper = run_pairs([], [[]], problem.drawn(held_out, seed, problem.paper_experiment))
    return Verdict(
        best=best,
        selection=replace(chosen, number=best.number),
        held_out=evaluator.judged(best.candidate, ours, scenarios),
        held_out_metrics={"best": ours, "paper": paper},
        within_reach=np.array(
            [within_reach(one.experiment if isinstance(one, Scenario) else one) for one in scenarios]
        ),
        paper=statistics(problem, paper),
    )


def _finals(
    problem: Problem, trials: Sequence[Evaluation], order: Sequence[int], evaluator: Evaluator
) -> tuple[Evaluation, Evaluation]:
    """The best as it was tuned, and what it came to in the selection scenarios.

    The very best where tuned are often the ones that only just hold: so the finalists are a ladder from the best to
    ever more cautious ones. The best of these among other draws and corners of the ensemble meet once more, in draws.
    """
    whole = [trials[place] for place in order if not trials[place].pruned]
    if len(problem.objectives) > 1:
        places = pareto_front(trials) or list(range(len(whole)))
        finalists = [trials[place] for place in places[:: -(-len(places) // FINALISTS)]]
    else:
        finalists = [whole[place] for place in rungs(whole)]
    first, last = problem.chosen_in(SELECTION_SCENARIOS, LAST_SCENARIOS, SELECTION_CORNERS, problem.seed + SELECTION)
    met = evaluator.over([one.candidate for one in finalists], first)
    left = best_first(met)[:LAST]
    again = evaluator.over([finalists[place].candidate for place in left], last)
    place = best_first(again)[0]
    return finalists[left[place]], again[place]


def rungs(ordered: Sequence[Evaluation]) -> list[int]:
    """Places of trials, the best first, each with an objective `RUNG` times that of the one before, or the next."""
    found = [0]
    for place, one in enumerate(ordered):
        if len(found) == FINALISTS:
            break
        above = ordered[found[-1]]
        if one.feasible != above.feasible or one.objectives[0] > RUNG * above.objectives[0]:
            found.append(place)
    rest = [place for place in range(len(ordered)) if place not in found]
    return sorted(found + rest[: FINALISTS - len(found)])


def statistics(problem: Problem, result: BatchResult) -> dict[str, float]:
    """Every reported statistic of the first row of a result."""
    done = result.outcomes[0] == "completed"
    return {one.name: one.over(result.metrics[one.metric][0, done]) for one in problem.reported}


def improvement(verdict: Verdict, name: str) -> float:
    """How many times a statistic of the best is below that of the paper's gains, where they were scored."""
    scored = verdict.held_out or verdict.best
    ours = scored.statistics[name]
    return verdict.paper[name] / ours if ours else np.inf


def improvement_within_reach(verdict: Verdict) -> float:
    """How many times the mean MSE is below the paper's over the held-out scenarios that the motors can hold.

    NaN without such a scenario that both ran to its end.
    """
    kept = verdict.within_reach.copy()
    for result in verdict.held_out_metrics.values():
        kept &= result.outcomes[0] == "completed"
    if not kept.any():
        return np.nan
    best, paper = (verdict.held_out_metrics[name].metrics["mse"][0, kept].mean() for name in ("best", "paper"))
    return float(paper / best)
