"""What those who took part in a race came to in the unseen scenarios, as data and as JSON."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.race.entry import Entry

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Runs:
    """The unseen scenarios, as some gains ran them.

    Attributes:
        outcomes: (scenarios,) ``completed``, ``diverged`` or ``left_track``.
        metrics: figure of merit → (scenarios,), as in `simulation.metrics.metrics.Metrics`.
        violations: constraint → how far it is exceeded there, as a share of its bound; <= 0: kept to.
        operations: arithmetic operations that the controller takes a sample.
    """

    outcomes: NDArray[np.str_]
    metrics: dict[str, Floats]
    violations: dict[str, float]
    operations: int

    @property
    def completed(self) -> NDArray[np.bool_]:
        """(scenarios,) whether each ran to its end."""
        return self.outcomes == "completed"

    @property
    def broken(self) -> tuple[str, ...]:
        """The constraints that are not kept to, the worst first."""
        return tuple(sorted((name for name, by in self.violations.items() if by > 0), key=self._least_kept))

    def _least_kept(self, name: str) -> float:
        return -self.violations[name]

    def over(self, statistic: Statistic) -> float:
        """A statistic over the scenarios that ran to their end; NaN without any."""
        return statistic.over(self.metrics[statistic.metric][self.completed])

    def to_record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "outcomes": self.outcomes.tolist(),
            "counts": dict(Counter(self.outcomes.tolist()).most_common()),
            "metrics": {name: _numbers(values) for name, values in self.metrics.items()},
            "violations": self.violations,
            "operations": self.operations,
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """What `to_record` took apart."""
        metrics = {name: np.array(values, float) for name, values in record["metrics"].items()}
        return cls(np.array(record["outcomes"]), metrics, record["violations"], record["operations"])


def runs_of(result: BatchResult, row: int, violations: Mapping[str, float], operations: int) -> Runs:
    """A row of a result."""
    metrics = {name: np.array(values[row], float) for name, values in result.metrics.items()}
    return Runs(result.outcomes[row], metrics, dict(violations), operations)


@dataclass(frozen=True)
class Paper:
    """The paper's gains, what others are compared with, and what no controller gets below.

    Attributes:
        runs: of the paper's controller with the paper's gains.
        least: (scenarios,) least mean square error in m² of a controller that does not foresee the scenario.
        least_foreseeing: (scenarios,) that of one that does.
    """

    runs: Runs
    least: Floats
    least_foreseeing: Floats

    def to_record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "runs": self.runs.to_record(),
            "least": self.least.tolist(),
            "least_foreseeing": self.least_foreseeing.tolist(),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """What `to_record` took apart."""
        runs = Runs.from_record(record["runs"])
        return cls(runs, *(np.array(record[name], float) for name in ("least", "least_foreseeing")))


@dataclass(frozen=True)
class Point:
    """A trial of a search, scored in the unseen scenarios.

    Attributes:
        cost: mean of the figure of merit that is traded for error, in its unit.
        error: mean square error in m², the mean of the scenarios.
        kept: whether every scenario is completed and every constraint kept to.
        gains: tuned key → value.
    """

    cost: float
    error: float
    kept: bool
    gains: dict[str, Any]


@dataclass(frozen=True)
class Search:
    """How the gains of an entry were found.

    Attributes:
        trials, rollouts: what the search had, the rollouts with those that gradients stand for.
        gains: number of gains that were searched for.
        seconds: wall time of all, preparing and scoring included.
        improved: whether the best is better than what the search began with.
        version: of the program.
    """

    trials: int
    rollouts: int
    gains: int
    seconds: float
    improved: bool
    version: str


@dataclass(frozen=True)
class Scored:
    """An entry with the best gains that were found for it.

    Attributes:
        entry: who.
        runs: of those gains in the unseen scenarios.
        gains: tuned key → value.
        fronts: figure of merit → what it costs in error, by cost.
        search: how the gains were found.
        stress: what breaks the gains first, the first first, each a label, a size and what is broken there; ``None``:
            nobody has asked.
    """

    entry: Entry
    runs: Runs
    gains: dict[str, Any]
    fronts: dict[str, tuple[Point, ...]]
    search: Search
    stress: tuple[dict[str, Any], ...] | None = None

    def to_record(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "entry": asdict(self.entry) | {"held": list(self.entry.held)},
            "runs": self.runs.to_record(),
            "gains": self.gains,
            "fronts": {name: [asdict(point) for point in points] for name, points in self.fronts.items()},
            "search": asdict(self.search),
            "stress": None if self.stress is None else list(self.stress),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """What `to_record` took apart."""
        entry = record["entry"]
        stress = record["stress"]
        return cls(
            entry=Entry(**(entry | {"held": tuple(entry["held"])})),
            runs=Runs.from_record(record["runs"]),
            gains=record["gains"],
            fronts={name: tuple(Point(**point) for point in points) for name, points in record["fronts"].items()},
            search=Search(**record["search"]),
            stress=None if stress is None else tuple(stress),
        )


def _numbers(values: Floats) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]
