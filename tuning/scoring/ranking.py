"""Ranking of candidates: by feasibility first, or by an exact penalty.

Results are ranked by feasibility first (`feasibility_first`; Deb, Comput. Methods Appl. Mech. Eng. 186, 2000). In that
order a search would descend into the nearest feasible valley, however poor: gains that are a thousand times better but
violate a bound by 1 % would rank below any feasible ones. Searches therefore rank by an exact penalty
(`penalised_first`; Nocedal and Wright, Numerical Optimization, 2006, Section 17.2).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.space import Point


@dataclass(frozen=True)
class Candidate:
    """A point to evaluate.

    Attributes:
        point: name of a dimension → value.
        origin: ``paper``, ``start`` or the name of a method.
    """

    point: Point
    origin: str


@dataclass(frozen=True)
class Evaluation:
    """The result of a candidate.

    Attributes:
        candidate: the evaluated candidate.
        objectives: their values in their units; NaN if no run has one.
        violations: constraint → violation as a share of its bound; <= 0: satisfied.
        statistics: such as ``mean.mse`` → value; NaN if no run has it.
        outcomes: outcome → number of scenarios.
        scenarios: number of scenarios run.
        pruned: whether scenarios were left out.
        violated: number of scenarios that violate a bound on the worst case or are incomplete.
        number: of the trial in the storage; -1 if it has none.
        units: name of a statistic → its unit.
    """

    candidate: Candidate
    objectives: tuple[float, ...]
    violations: dict[str, float]
    statistics: dict[str, float]
    outcomes: dict[str, int]
    scenarios: int
    pruned: bool = False
    violated: int = 0
    number: int = -1
    units: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def point(self) -> Point:
        """The candidate's point."""
        return self.candidate.point

    @property
    def costs(self) -> tuple[float, ...]:
        """The objectives for ranking, with infinity in place of NaN."""
        return tuple(math.inf if math.isnan(value) else value for value in self.objectives)

    @property
    def violation(self) -> float:
        """Sum of the constraint violations; 0 if all are satisfied."""
        return sum(max(value, 0.0) for value in self.violations.values())

    def violation_of(self, constraints: Iterable[Constraint], *kinds: str) -> float:
        """Sum of the violations of constraints of some kinds (`Constraint.kind`)."""
        labels = (constraint.label for constraint in constraints if constraint.kind in kinds)
        return sum(max(self.violations.get(label, 0.0), 0.0) for label in labels)

    @property
    def feasible(self) -> bool:
        """Whether it completed all scenarios and satisfies every constraint."""
        return not self.pruned and self.violation <= 0


def feasibility_first(evaluations: Sequence[Evaluation]) -> list[int]:
    """Rank evaluations by feasibility first (Deb's rules); return their indices, the best first.

    Feasible ones come first, by objective (several: by the number of their front), then infeasible ones by violation,
    then pruned ones.
    """
    fronts = _front_numbers(evaluations)

    def key(index: int) -> tuple[bool, float, float, float]:
        evaluation = evaluations[index]
        return evaluation.pruned, evaluation.violation, float(fronts[index]), evaluation.costs[0]

    return sorted(range(len(evaluations)), key=key)


def merit(evaluation: Evaluation, penalty: float = TuningOptions.penalty) -> float:
    """Exact penalty function: the first objective's logarithm plus a penalty on the sum of violations.

    The least is best. Of an objective that is not positive, its value takes the logarithm's place.
    """
    cost = evaluation.costs[0]
    return (math.log(cost) if cost > 0 else cost) + penalty * evaluation.violation


def penalised_first(evaluations: Sequence[Evaluation], penalty: float = TuningOptions.penalty) -> list[int]:
    """Rank evaluations by `merit`, for a search; return their indices, the best first.

    With several objectives, or one that is not positive, the order is `feasibility_first`.
    """
    if not all(len(evaluation.objectives) == 1 and evaluation.costs[0] > 0 for evaluation in evaluations):
        return feasibility_first(evaluations)
    return sorted(range(len(evaluations)), key=lambda index: merit(evaluations[index], penalty))


def improves_on(evaluation: Evaluation, start: Evaluation, constraints: Sequence[Constraint]) -> bool:
    """Whether an evaluation improves on the start in the same scenarios.

    It does if it is feasible and the start is not; if an objective is smaller and its violation is not larger; or if it
    violates bounds on the worst case in fewer scenarios, and bounds on means and stability margins no more.
    """
    smaller = any(cost < before for cost, before in zip(evaluation.costs, start.costs, strict=True))
    if evaluation.feasible and not start.feasible:
        return True
    violation, start_violation = (each.violation_of(constraints, "mean", "margin") for each in (evaluation, start))
    if evaluation.violated < start.violated and violation <= start_violation:
        return not evaluation.pruned
    return smaller and not evaluation.pruned and evaluation.violation <= start.violation


def pareto_front(evaluations: Sequence[Evaluation]) -> list[int]:
    """Indices of the non-dominated feasible evaluations, in order of the objectives."""
    feasible = [index for index, evaluation in enumerate(evaluations) if evaluation.feasible]
    values = np.array([evaluations[index].costs for index in feasible])
    front = [index for index, row in zip(feasible, values, strict=True) if not _dominated(row, values)]
    return sorted(front, key=lambda index: evaluations[index].objectives)


def undominated(costs: ArrayLike, errors: ArrayLike) -> list[int]:
    """Indices of the non-dominated of some points (points,), the Pareto front, in order of cost."""
    front: list[int] = []
    across, heights = np.asarray(costs), np.asarray(errors)
    for index in np.lexsort((heights, across)).tolist():
        if not front or heights[index] < heights[front[-1]]:
            front.append(index)
    return front


def _dominated(row: np.ndarray, others: np.ndarray) -> bool:
    return bool(((others <= row).all(axis=1) & (others < row).any(axis=1)).any())


def _front_numbers(evaluations: Sequence[Evaluation]) -> list[int]:
    """Number of each evaluation's front by non-dominated sorting, from 0; all 0 with a single objective."""
    numbers = [0] * len(evaluations)
    if not evaluations or len(evaluations[0].objectives) == 1:
        return numbers
    values = np.array([evaluation.costs for evaluation in evaluations])
    remaining, number = np.arange(len(values)), 0
    while len(remaining):
        dominated = np.array([_dominated(values[index], values[remaining]) for index in remaining])
        for index in remaining[~dominated]:
            numbers[index] = number
        remaining, number = remaining[dominated], number + 1
    return numbers
