"""The result of an ensemble: what each scenario came to, and statistics over all of them."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.statistic import KINDS, Statistic, statistic_from


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
        metrics: figure of merit → (scenarios,), as in `simulation.metrics.metrics.Metrics`.
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

    def statistic(self, name: str) -> float:
        """A statistic by its name, such as ``worst.mse``, over the scenarios that ran to their end.

        A run that ended early measured something else, so it is counted in `outcome_counts` and left out here. NaN
        where there is nothing to measure.

        Raises:
            ConfigurationError: unknown statistic or figure of merit.
        """
        return self._over(statistic_from(name, self.ensemble.experiment.metrics))

    @property
    def statistics(self) -> dict[str, dict[str, float]]:
        """Figure of merit → ``mean``, ``median``, ``p95`` and ``worst`` → value."""
        return {metric: {kind: self.statistic(f"{kind}.{metric}") for kind in KINDS} for metric in self.metrics}

    def _over(self, statistic: Statistic) -> float:
        return statistic.over(self.metrics[statistic.metric][self.completed])
