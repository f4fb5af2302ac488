"""Scores of a race's entries on the test set, as data, JSON and text."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import batches, intervals, merit_statistics, run_outcomes, searching
from dualwinch.toolboxes.race.comparison import finite_or_none
from dualwinch.toolboxes.race.entries import RaceEntry

Floats = NDArray[np.float64]

ERROR = "mse"
"""Metric of the error in the fronts."""

COSTS = ("chatter", "continuous_load")
"""Metrics traded for error in the fronts."""

STATISTICS = (
    "mean.mse",
    "median.mse",
    "p95.mse",
    "worst.max_abs_error",
    "mean.chatter",
    "mean.continuous_load",
    "worst.peak_tension",
    "worst.min_tension",
    "mean.slack_share",
    "mean.energy",
)
"""Statistics of every entry on the test set."""


@dataclass(frozen=True, eq=False)
class ScoredRuns(run_outcomes.RunOutcomes):
    """Runs of a controller on the test set; arrays of outcomes are (scenarios,).

    Attributes:
        violations: constraint → its violation, as a share of its bound; <= 0: satisfied.
        operations: arithmetic operations of the controller per sample.
    """

    violations: dict[str, float]
    operations: int

    @property
    def violated(self) -> tuple[str, ...]:
        """The violated constraints, the worst first."""
        violated = [name for name, by in self.violations.items() if by > 0]
        return tuple(sorted(violated, key=self.violations.__getitem__, reverse=True))

    def over(self, statistic: merit_statistics.Statistic) -> float:
        """A statistic over the completed scenarios; NaN without any."""
        return statistic.over(self.of_completed(statistic.metric))

    @property
    def verdict(self) -> str:
        """``satisfied`` if all constraints are; else the number of incomplete scenarios or the worst violation."""
        lost = int((~self.completed).sum())
        if lost:
            return f"{lost} of {len(self.outcomes)} scenarios not completed"
        return f"violated: {self.violated[0]}" if self.violated else "satisfied"

    def to_record(self) -> dict[str, Any]:
        """The entry of ``race.json``."""
        statistics = [merit_statistics.statistic_from(name) for name in STATISTICS]
        values = {statistic.name: finite_or_none(self.over(statistic)) for statistic in statistics}
        return {
            "statistics": values,
            "rms_error": None if (mse := values["mean.mse"]) is None else math.sqrt(mse),
            "completed": int(np.count_nonzero(self.completed)),
            "violated": list(self.violated),
            "operations": self.operations,
        }


def scored_runs(result: batches.BatchResult, violations: Mapping[str, float], operations: int) -> ScoredRuns:
    """The scored runs of a batch with a single row."""
    runs = run_outcomes.RunOutcomes(result.outcomes, result.end_times, result.metrics).take(0, axis=0)
    return ScoredRuns(**vars(runs), violations=dict(violations), operations=operations)


@dataclass(frozen=True)
class BaselineScore:
    """The paper's gains as baseline, and lower bounds on the error of any controller.

    Attributes:
        runs: of the paper's controller with the paper's gains.
        lower_bounds: lower bounds on the error in each scenario.
    """

    runs: ScoredRuns
    lower_bounds: batches.LeastErrors


@dataclass(frozen=True)
class FrontPoint:
    """A trial of a search, scored on the test set.

    Attributes:
        cost: mean of the metric traded for error, in its unit.
        error: mean square error in m², averaged over the scenarios.
        feasible: whether every scenario is completed and every constraint satisfied.
        gains: tuned key → value.
    """

    cost: float
    error: float
    feasible: bool
    gains: dict[str, Any]


@dataclass(frozen=True)
class SearchRecord:
    """Record of the search of an entry.

    Attributes:
        trials, rollouts: their numbers; rollouts include the equivalents of gradients.
        gains: number of tuned gains.
        seconds: wall time, preparation and scoring included.
        improved: whether the best is better than the start.
        version: of the program.
    """

    trials: int
    rollouts: int
    gains: int
    seconds: float
    improved: bool
    version: str


@dataclass(frozen=True)
class EntryResult:
    """An entry with its best gains.

    Attributes:
        entry: its parts.
        runs: of those gains on the test set.
        gains: tuned key → value.
        fronts: metric → its front against the error, by cost.
        search: record of the search.
        stress: least robustness margins, each a label, a size and the violated limit; ``None``: not computed.
    """

    entry: RaceEntry
    runs: ScoredRuns
    gains: dict[str, Any]
    fronts: dict[str, tuple[FrontPoint, ...]]
    search: SearchRecord
    stress: tuple[dict[str, Any], ...] | None = None


FRONT_POINTS = 8
"""Largest number of points of a front that are scored on the test set."""


def front(trials: Sequence[searching.Evaluation], cost: str, most: int = FRONT_POINTS) -> list[searching.Evaluation]:
    """The Pareto front of a search's feasible trials, from the least cost, one of `COSTS`, to the least error.

    It has at most `most` points, spread evenly over the front with both its ends.
    """
    feasible = [trial for trial in trials if trial.feasible]
    costs, errors = (np.array([trial.statistics[f"mean.{name}"] for trial in feasible]) for name in (cost, ERROR))
    front_indices = searching.undominated(costs, errors)
    sample = dict.fromkeys(
        np.linspace(0, len(front_indices) - 1, min(most, len(front_indices))).round().astype(int).tolist()
    )
    return [feasible[front_indices[index]] for index in sample]


def below_words(interval: intervals.Interval) -> str:
    """Factor by which an error is below another, with its interval, from their ratio's: ``16 500 × (...)``."""
    if math.isnan(interval.estimate):
        return "–"
    factor, low, high = (
        spaced(math.inf if not ratio else 1 / ratio) for ratio in (interval.estimate, interval.high, interval.low)
    )
    return f"{factor} × ({low}–{high})"


def spaced(number: float) -> str:
    """A positive number to three digits, without an exponent, thousands separated by a space."""
    rounded = float(f"{number:.3g}")
    return f"{rounded:,.0f}".replace(",", "\u202f") if 100 <= rounded < math.inf else f"{rounded:.3g}"


def ratio_words(interval: intervals.Interval) -> str:
    """A ratio with its interval, to three digits each."""
    if math.isnan(interval.estimate):
        return "–"
    return f"{spaced(interval.estimate)} ({spaced(interval.low)}–{spaced(interval.high)})"
