"""The scenarios in which the best is chosen, round by round; no search has seen them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import SELECTION, TuningProblem
from dualwinch.tuning.scoring.config import SampleSizes
from dualwinch.tuning.scoring.evaluation import Scorer
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.rollouts import joined, row_of, worst_of
from dualwinch.tuning.scoring.training_set import (
    beyond_authority,
    drawn,
    every_second_nominal,
    hardest_among,
    vertices,
    within_selection,
)


def validation_sets(problem: TuningProblem, plan: SampleSizes) -> tuple[list[Scenario], list[Scenario], list[Scenario]]:
    """Scenarios to choose in, of both rounds, and overwhelming ones.

    Draws (`within_selection`), to the first of which hard ones and vertices come.
    """
    if problem.ensemble is None:
        raise ValueError("only an ensemble has scenarios to choose in")
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    seed, drawn_before = problem.seed + SELECTION, plan.draws + plan.last_draws
    corners = vertices(ensemble, plan.vertices, seed)
    further = range(drawn_before, drawn_before + plan.looked_at)
    picks = [*hardest_among(ensemble, plan.hard, further, seed), *corners]
    draws = list(ensemble.scenarios(drawn_before, seed))
    first = [*drawn(picks, ensemble, seed), *within_selection(draws[: plan.draws])]
    beyond = drawn(beyond_authority(ensemble, seed, corners), ensemble, seed)
    return first, within_selection(every_second_nominal(draws[plan.draws :])), beyond


def further_draws(problem: TuningProblem, plan: SampleSizes) -> list[Scenario]:
    """Draws behind all those in which the best is chosen; none without an ensemble."""
    if problem.ensemble is None:
        return []
    before = plan.draws + plan.last_draws + plan.looked_at
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    return ensemble.chosen(range(before, before + plan.confirmed), problem.seed + SELECTION)


RUNG, GROWTH = 0.02, 1.17
"""How much larger, as a share, the objective of the second finalist is than that of the first, where they were tuned;
and by which factor that grows from each to the next. The best are told apart; the last is three times the first."""

Validated = tuple[Evaluation, Evaluation]
"""A trial as it was tuned, and what it came to in more scenarios."""


def validated(
    ordered: Sequence[Evaluation],
    first: Sequence[Evaluation],
    held: Callable[[Sequence[Evaluation]], list[Validated]],
    go_on: Callable[[], bool],
) -> list[Validated]:
    """Trials that hold in more scenarios, among them the best that does, or nearly.

    The very best where tuned are often the ones that only just hold, and far from them are some that surely do. So a
    first ladder leads from the best to these; each further one, of as many, from the best to the best that held.

    Args:
        ordered: trials, the best first, each with a number of its own.
        first: of these the first ladder.
        held: tries trials, and gives those that hold.
        go_on: whether there may be a further ladder.
    """
    met, most = held(first), len(first)
    waiting, over = list(ordered), {trial.number for trial in first}
    while go_on():
        holding = {trial.number for trial, _ in met}
        end = next((index for index, trial in enumerate(waiting) if trial.number in holding), len(waiting))
        waiting = [trial for trial in waiting[:end] if trial.number not in over]
        if not waiting:
            break
        ladder = [waiting[index] for index in evenly(len(waiting), most)]
        over = {trial.number for trial in ladder}
        met += held(ladder)
    return met


def evenly(count: int, most: int) -> list[int]:
    """So many indices of a sequence, at most, spread evenly from its first on."""
    number = min(count, most)
    return [share * count // number for share in range(number)]


def strata(ordered: Sequence[Evaluation], most: int) -> list[int]:
    """Indices of trials: the best, then of each further rung the one that keeps furthest from its bounds.

    A rung holds the trials whose objective is a share larger than that of its first one, ever more of them (`RUNG`).

    Args:
        ordered: trials, the best first.
        most: number of indices, at most.
    """
    starts = [0]
    for index, trial in enumerate(ordered):
        above, width = ordered[starts[-1]], 1 + RUNG * GROWTH ** (len(starts) - 1)
        if trial.objectives[0] > width * above.objectives[0]:
            starts.append(index)
    ends = [*starts[1:], len(ordered)]
    further = [
        max(range(start, end), key=lambda index: ordered[index].reserve)
        for start, end in zip(starts[1:most], ends[1:most], strict=True)
    ]
    found = [0, *further]
    rest = [index for index in range(len(ordered)) if index not in found]
    return sorted(found + rest[: most - len(found)])


FIRST = 12
"""Scenarios in which trials meet first."""


@dataclass(frozen=True)
class ScreenResult:
    """What a trial came to in the scenarios of a sieve.

    Attributes:
        result: in all of them; ``None`` where it does not hold where most have failed.
        excess: by how much it exceeds the bound that it exceeds the most, as a share, in those that it was run in;
            negative where it keeps to all, infinite where it did not end.
    """

    result: Evaluation | None
    excess: float

    @property
    def held(self) -> Evaluation | None:
        """The result where it keeps to every constraint."""
        return self.result if self.result is not None and self.result.feasible else None


class FeasibilityScreen:
    """Scenarios in which trials meet, those first in which most have failed.

    Attributes:
        scenarios: all of them.
        constraints: with bounds that are numbers there.
    """

    def __init__(self, scorer: Scorer, scenarios: Sequence[Scenario]) -> None:
        """Run the paper's controller, which bounds may refer to."""
        self.scenarios, self.constraints = list(scenarios), scorer.bounds(scenarios)
        self._scorer, self._machines = scorer, scorer.survey(scenarios)
        self._failures = np.array([scenario.hard for scenario in scenarios], float)

    def meet(self, candidates: Sequence[Candidate]) -> list[ScreenResult]:
        """What candidates come to, in all scenarios where they hold where most have failed.

        Stability margins are looked at where all else holds.
        """
        if not candidates:
            return []
        order = np.argsort(-self._failures, kind="stable")
        first, rest = order[:FIRST], order[FIRST:]
        early = self._scorer.run(candidates, self._chosen(first), to_the_end=False)
        excess = self._excess(early, first).max(axis=1)
        kept = np.flatnonzero(excess <= 0).tolist()
        found = [ScreenResult(None, float(each)) for each in excess]
        if not kept:
            return found
        going_on = [candidates[row] for row in kept]
        late, hold = None, [True] * len(kept)
        if len(rest):
            late = self._scorer.run(going_on, self._chosen(rest), to_the_end=False)
            excess[kept] = np.maximum(excess[kept], self._excess(late, rest).max(axis=1))
            hold = (excess[kept] <= 0).tolist()
        margins, met = self._scorer.margins(going_on, self._machines, hold), self._chosen(order)
        for number, row in enumerate(kept):
            whole = joined(row_of(early, row), late, number) if late else row_of(early, row)
            result = self._scorer.judged(
                candidates[row], whole, met, margins=margins[number], constraints=self.constraints
            )
            found[row] = ScreenResult(result, float(excess[row]))
        return found

    def _chosen(self, indices: NDArray[np.intp]) -> list[Scenario]:
        return [self.scenarios[index] for index in indices]

    def _excess(self, result: BatchResult, indices: NDArray[np.intp]) -> NDArray[np.float64]:
        """By how much runs in some scenarios exceed a bound on what is the worst (`worst_of`); failures are counted."""
        excess = worst_of(result, self.constraints, self._chosen(indices))
        self._failures[indices] += (excess > 0).sum(axis=0)
        return excess
