"""What evaluating a candidate gave."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dualwinch.tuning.space import Point


@dataclass(frozen=True)
class Candidate:
    """A point to evaluate.

    Attributes:
        point: name of a dimension → value.
        origin: where it comes from: ``paper``, ``start`` or the name of a method.
    """

    point: Point
    origin: str


@dataclass(frozen=True)
class Evaluation:
    """A candidate and what it came to.

    Attributes:
        candidate: what was evaluated.
        objectives: one a objective, in its unit; finite.
        violations: constraint → how far it is exceeded, as a share of its bound; <= 0: kept to.
        statistics: such as ``mean.mse`` → value; finite.
        outcomes: outcome → number of scenarios.
        scenarios: number of scenarios that were run.
        pruned: whether it was given up before the last scenario.
        number: of the trial in the storage; -1 where it has none.
        units: unit of each of the statistics.
    """

    candidate: Candidate
    objectives: tuple[float, ...]
    violations: dict[str, float]
    statistics: dict[str, float]
    outcomes: dict[str, int]
    scenarios: int
    pruned: bool = False
    number: int = -1
    units: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def point(self) -> Point:
        """The candidate's point."""
        return self.candidate.point

    @property
    def violation(self) -> float:
        """Sum of what is exceeded; 0 where every constraint is kept to."""
        return sum(max(value, 0.0) for value in self.violations.values())

    @property
    def reserve(self) -> float:
        """Distance from the nearest bound on what is the worst of all scenarios, as its share; more draws are worse."""
        return -max((value for label, value in self.violations.items() if label.startswith("worst.")), default=0.0)

    @property
    def feasible(self) -> bool:
        """Whether it completed all scenarios and keeps to every constraint."""
        return not self.pruned and self.violation <= 0


def best_first(evaluations: Sequence[Evaluation]) -> list[int]:
    """Indices of the evaluations, the best first.

    What was given up early comes last. Among the others the feasible come first, by objective (several: by the number
    of the front they are on), then the infeasible by how much they violate.
    """
    fronts = _front_numbers(evaluations)

    def key(index: int) -> tuple[bool, float, float, float]:
        evaluation = evaluations[index]
        return evaluation.pruned, evaluation.violation, float(fronts[index]), evaluation.objectives[0]

    return sorted(range(len(evaluations)), key=key)


PENALTY = 50.0
"""What a violation of a bound by its whole size adds to the logarithm of an objective: 2 % too much cost a factor of e.

Where an optimum lies on its bounds, giving way by a share gains the objective a few times that share at most: far less.
"""


def penalised_first(evaluations: Sequence[Evaluation]) -> list[int]:
    """Indices of the evaluations, the most promising first: what a search should follow.

    By the objective's logarithm with a penalty on what is violated; what was given up early comes last. Of several
    objectives, or of one that need not be positive, the best come first.
    """
    if not _penalisable(evaluations):
        return best_first(evaluations)

    def key(index: int) -> tuple[bool, float]:
        evaluation = evaluations[index]
        return evaluation.pruned, math.log(evaluation.objectives[0]) + PENALTY * evaluation.violation

    return sorted(range(len(evaluations)), key=key)


def backed_off_first(evaluations: Sequence[Evaluation], margin: float) -> list[int]:
    """Indices of the evaluations, that first which should be presented: the best that is likely to hold in more draws.

    As `best_first`, but among the feasible what comes nearer to a bound than the margin, in the worst scenario, has to
    make up for it: by as much as `penalised_first` asks of what violates a bound by what is missing.

    Args:
        evaluations: all in the same scenarios.
        margin: distance from a bound, as its share.
    """
    order = best_first(evaluations)
    if not _penalisable(evaluations):
        return order
    feasible = [index for index in order if evaluations[index].feasible]

    def worth(index: int) -> float:
        evaluation = evaluations[index]
        return math.log(evaluation.objectives[0]) + PENALTY * max(margin - evaluation.reserve, 0.0)

    return sorted(feasible, key=worth) + [index for index in order if not evaluations[index].feasible]


def _penalisable(evaluations: Sequence[Evaluation]) -> bool:
    """Whether the objective has a logarithm: there is one, and it is positive."""
    return all(len(evaluation.objectives) == 1 and evaluation.objectives[0] > 0 for evaluation in evaluations)


def improves_on(evaluation: Evaluation, start: Evaluation) -> bool:
    """Whether an evaluation is better than the start in the same scenarios, so that it may be presented as such.

    A feasible one is where the start is not, or where it has a smaller objective (several: one of them smaller). One
    that is not feasible has to violate no more than the start and to have a smaller objective as well.
    """
    smaller = any(ours < theirs for ours, theirs in zip(evaluation.objectives, start.objectives, strict=True))
    if evaluation.feasible and not start.feasible:
        return True
    return smaller and not evaluation.pruned and evaluation.violation <= start.violation


def pareto_front(evaluations: Sequence[Evaluation]) -> list[int]:
    """Indices of the feasible evaluations that no other feasible one beats in every objective, by the first one."""
    feasible = [index for index, evaluation in enumerate(evaluations) if evaluation.feasible]
    values = np.array([evaluations[index].objectives for index in feasible])
    kept = [index for index, row in zip(feasible, values, strict=True) if not _dominated(row, values)]
    return sorted(kept, key=lambda index: evaluations[index].objectives)


def _dominated(row: np.ndarray, others: np.ndarray) -> bool:
    return bool(((others <= row).all(axis=1) & (others < row).any(axis=1)).any())


def _front_numbers(evaluations: Sequence[Evaluation]) -> list[int]:
    """For several objectives: 0 for what none beats, 1 for what only those beat, and so on; else 0 throughout."""
    numbers = [0] * len(evaluations)
    if not evaluations or len(evaluations[0].objectives) == 1:
        return numbers
    values = np.array([evaluation.objectives for evaluation in evaluations])
    left, number = np.arange(len(values)), 0
    while len(left):
        beaten = np.array([_dominated(values[index], values[left]) for index in left])
        for index in left[~beaten]:
            numbers[index] = number
        left, number = left[beaten], number + 1
    return numbers
