"""The result of an ensemble: what each scenario came to, and statistics over all of them."""

from collections import Counter
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.loop.metrics import Metrics

METRICS = tuple(field.name for field in fields(Metrics))
"""Names of the figures of merit."""

SMALL_IS_BAD = frozenset({"min_tension"})
"""Figures of merit whose bad end is the small one; of all others it is the large one."""


@dataclass(frozen=True)
class Statistic:
    """One figure of merit over the scenarios that ran to their end.

    Attributes:
        mean, median: over the scenarios.
        p95: 95 % of the scenarios are no worse than this.
        worst: of all scenarios: the smallest for `SMALL_IS_BAD`, else the largest.
    """

    mean: float
    median: float
    p95: float
    worst: float


@dataclass(frozen=True)
class Traces:
    """Signals of the scenarios that ran to their end, at the same instants.

    Attributes:
        t: (points,) time in s.
        sampled: column → (scenarios, points) float32, of the first scenarios up to a fixed number: a fair sample, as
            the scenarios do not depend on each other.
        lowest, highest: column → (points,) float32, over all scenarios.
    """

    t: NDArray[np.float64]
    sampled: dict[str, NDArray[np.float32]]
    lowest: dict[str, NDArray[np.float32]]
    highest: dict[str, NDArray[np.float32]]

    def quantiles(self, column: str, shares: tuple[float, ...]) -> NDArray[np.float64]:
        """(shares, points): the values that these shares (0 to 1) of the scenarios do not exceed at each instant."""
        return np.quantile(self.sampled[column].astype(float), shares, axis=0)


@dataclass(frozen=True)
class EnsembleResult:
    """What the scenarios of an ensemble came to.

    Attributes:
        ensemble: what was drawn from.
        seed: of the draws.
        asked: number of scenarios asked for; more than there are where the run was interrupted.
        draws: key → (scenarios,) drawn values.
        outcomes: (scenarios,) ``completed``, ``diverged`` or ``left_track``.
        end_times: (scenarios,) time in s at which each run ended.
        metrics: figure of merit → (scenarios,), as in `simulation.loop.metrics.Metrics`.
        traces: of the scenarios that ran to their end; ``None`` where none were kept or none completed.
    """

    ensemble: Ensemble
    seed: int
    asked: int
    draws: dict[str, NDArray[Any]]
    outcomes: tuple[str, ...]
    end_times: NDArray[np.float64]
    metrics: dict[str, NDArray[np.float64]]
    traces: Traces | None

    def __len__(self) -> int:
        """Number of scenarios that were run."""
        return len(self.outcomes)

    @property
    def partial(self) -> bool:
        """Whether the run was interrupted; what is here is what asking for ``len(self)`` scenarios gives."""
        return len(self) < self.asked

    @property
    def outcome_counts(self) -> dict[str, int]:
        """Outcome → number of scenarios, the most frequent first."""
        return dict(Counter(self.outcomes).most_common())

    @property
    def completed(self) -> NDArray[np.bool_]:
        """(scenarios,) whether each ran to its end."""
        return np.array([outcome == "completed" for outcome in self.outcomes], dtype=bool)

    def statistic(self, metric: str) -> Statistic:
        """Mean, median, 95 % and worst of a figure of merit over the scenarios that ran to their end.

        A run that ended early measured something else, so it is counted in `outcome_counts` and left out here. NaN
        where there is nothing to measure.
        """
        values = self.metrics[metric][self.completed]
        values = values[np.isfinite(values)]
        if not len(values):
            return Statistic(np.nan, np.nan, np.nan, np.nan)
        small = metric in SMALL_IS_BAD
        return Statistic(
            mean=float(values.mean()),
            median=float(np.median(values)),
            p95=float(np.quantile(values, 0.05 if small else 0.95)),
            worst=float(values.min() if small else values.max()),
        )

    @property
    def statistics(self) -> dict[str, Statistic]:
        """Figure of merit → its statistic."""
        return {metric: self.statistic(metric) for metric in METRICS}
