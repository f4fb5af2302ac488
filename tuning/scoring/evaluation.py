"""What evaluating a candidate gave."""

from collections.abc import Mapping
from dataclasses import dataclass, field

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
