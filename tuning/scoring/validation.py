"""Validation sets: scenarios of a stream of their own, in which trials are screened for feasibility.

A constraint that is satisfied in the few training scenarios may be violated in others. So the choice is made in further
ones: a first set of draws, hard draws, vertices and, where that does not cost too much, scenarios beyond the actuators'
authority; a second set of draws; and further draws for the chosen candidate alone.

Trials are screened sequentially (`FeasibilityScreen`): hardest scenarios first, out at the first violation. Which are
screened follows strata of the training objective (`strata`, `screened_by_strata`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import VALIDATION, TuningProblem
from dualwinch.tuning.scoring.evaluation import Scorer
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.rollouts import joined, row_of, worst_of
from dualwinch.tuning.scoring.training_set import (
    beyond_authority,
    drawn,
    every_second_nominal,
    hardest_among,
    validation_draws,
    vertices,
)
from dualwinch.tuning.selection_config import SampleSizes, SelectionConfig


def validation_sets(
    problem: TuningProblem, sizes: SampleSizes
) -> tuple[list[Scenario], list[Scenario], list[Scenario]]:
    """The first and the second validation set, and scenarios beyond authority."""
    if problem.ensemble is None:
        raise ValueError("only an ensemble has validation scenarios")
    ensemble, config = replace(problem.ensemble, experiment=problem.experiment), problem.selection
    seed, count = problem.stream(VALIDATION), sizes.draws + sizes.second_draws
    corners = vertices(ensemble, sizes.vertices, seed)
    further = range(count, count + sizes.hard_among)
    hard = [*hardest_among(ensemble, sizes.hard_draws, further, seed, config), *corners]
    draws = list(ensemble.scenarios(count, seed))
    first = [*drawn(hard, ensemble, seed), *validation_draws(draws[: sizes.draws], config)]
    beyond = drawn(beyond_authority(ensemble, seed, corners, config), ensemble, seed)
    return first, validation_draws(every_second_nominal(draws[sizes.draws :]), config), beyond


def further_draws(problem: TuningProblem, sizes: SampleSizes) -> list[Scenario]:
    """Draws beyond both validation sets; none without an ensemble."""
    if problem.ensemble is None:
        return []
    before = sizes.draws + sizes.second_draws + sizes.hard_among
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    return ensemble.chosen(range(before, before + sizes.further_draws), problem.stream(VALIDATION))


@dataclass(frozen=True)
class ScreenResult:
    """The result of a trial in a validation set.

    Attributes:
        result: in all scenarios; ``None`` where a bound is violated in the first.
        excess: largest violation of a bound on the worst case in those scenarios that were run, as a share; negative
            where all are satisfied, infinite where a run was not completed.
    """

    result: Evaluation | None
    excess: float

    @property
    def feasible(self) -> Evaluation | None:
        """The result where it satisfies every constraint."""
        return self.result if self.result is not None and self.result.feasible else None


class FeasibilityScreen:
    """Sequential evaluation of trials in a validation set: hardest scenarios first, out at the first violation.

    Gains that are infeasible mostly fail in the same few scenarios, so the order is by the number of failures so far.

    Attributes:
        scenarios: of the set.
        constraints: with bounds that are numbers there.
    """

    def __init__(self, scorer: Scorer, scenarios: Sequence[Scenario]) -> None:
        """Run the baseline controller, which bounds may refer to."""
        self.scenarios, self.constraints = list(scenarios), scorer.bounds(scenarios)
        self._scorer, self._machines = scorer, scorer.survey(scenarios)
        self._config = scorer.training.problem.selection
        self._failures = np.array([scenario.hard for scenario in scenarios], float)

    def screen(self, candidates: Sequence[Candidate]) -> list[ScreenResult]:
        """The results of candidates; stability margins are computed where all else is satisfied."""
        if not candidates:
            return []
        order = np.argsort(-self._failures, kind="stable")
        first, rest = order[: self._config.first_screened], order[self._config.first_screened :]
        early = self._scorer.run(candidates, self._chosen(first), to_the_end=False)
        excess = self._excess(early, first).max(axis=1)
        kept = np.flatnonzero(excess <= 0).tolist()
        found = [ScreenResult(None, float(each)) for each in excess]
        if not kept:
            return found
        going_on = [candidates[row] for row in kept]
        late, feasible = None, [True] * len(kept)
        if len(rest):
            late = self._scorer.run(going_on, self._chosen(rest), to_the_end=False)
            excess[kept] = np.maximum(excess[kept], self._excess(late, rest).max(axis=1))
            feasible = (excess[kept] <= 0).tolist()
        margins, scenarios = self._scorer.margins(going_on, self._machines, feasible), self._chosen(order)
        for number, row in enumerate(kept):
            whole = joined(row_of(early, row), late, number) if late else row_of(early, row)
            result = self._scorer.evaluation(
                candidates[row], whole, scenarios, margins=margins[number], constraints=self.constraints
            )
            found[row] = ScreenResult(result, float(excess[row]))
        return found

    def _chosen(self, indices: NDArray[np.intp]) -> list[Scenario]:
        return [self.scenarios[index] for index in indices]

    def _excess(self, result: BatchResult, indices: NDArray[np.intp]) -> NDArray[np.float64]:
        """Violations of bounds on the worst case in some scenarios (`worst_of`); failures are counted."""
        excess = worst_of(result, self.constraints, self._chosen(indices), self._config.leeway_beyond_authority)
        self._failures[indices] += (excess > 0).sum(axis=0)
        return excess


Validated = tuple[Evaluation, Evaluation]
"""A trial in the training set, and in a validation set."""


def strata(ordered: Sequence[Evaluation], most: int, config: SelectionConfig) -> list[int]:
    """Indices of trials: the best, then of each further stratum of the objective the one with the largest clearance.

    A stratum holds the trials whose objective is within a share of that of its first one; the share grows from each to
    the next. So the best are told apart, and the last are ever more cautious.

    Args:
        ordered: trials, the best first.
        most: number of indices, at most.
        config: width of the first stratum, and its growth.
    """
    starts = [0]
    for index, trial in enumerate(ordered):
        above, width = ordered[starts[-1]], 1 + config.stratum * config.stratum_growth ** (len(starts) - 1)
        if trial.objectives[0] > width * above.objectives[0]:
            starts.append(index)
    ends = [*starts[1:], len(ordered)]
    further = [
        max(range(start, end), key=lambda index: ordered[index].clearance)
        for start, end in zip(starts[1:most], ends[1:most], strict=True)
    ]
    found = [0, *further]
    rest = [index for index in range(len(ordered)) if index not in found]
    return sorted(found + rest[: most - len(found)])


def screened_by_strata(
    ordered: Sequence[Evaluation],
    first: Sequence[Evaluation],
    screen: Callable[[Sequence[Evaluation]], list[Validated]],
    go_on: Callable[[], bool],
) -> list[Validated]:
    """Trials that are feasible in a validation set, among them the best or nearly the best of all such.

    The very best in training are often the ones that only just satisfy their bounds. So a first group reaches from the
    best to cautious ones; each further group, of as many, from the best to the best that was feasible.

    Args:
        ordered: trials, the best first, each with a number of its own.
        first: the first group.
        screen: screens trials, and returns the feasible ones.
        go_on: whether there may be a further group.
    """
    found, most = screen(first), len(first)
    waiting, screened = list(ordered), {trial.number for trial in first}
    while go_on():
        feasible = {trial.number for trial, _ in found}
        end = next((index for index, trial in enumerate(waiting) if trial.number in feasible), len(waiting))
        waiting = [trial for trial in waiting[:end] if trial.number not in screened]
        if not waiting:
            break
        group = [waiting[index] for index in evenly(len(waiting), most)]
        screened = {trial.number for trial in group}
        found += screen(group)
    return found


def evenly(count: int, most: int) -> list[int]:
    """So many indices of a sequence, at most, spread evenly from its first on."""
    number = min(count, most)
    return [share * count // number for share in range(number)]
