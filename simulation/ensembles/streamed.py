"""Streaming statistics of an ensemble, without storing its scenarios: memory does not grow with their number.

Sums are exact and quantiles come from counts (DDSketch: C. Masson, J. E. Rim and H. K. Lee, Proc. VLDB Endowment 12
(2019) 2195), so that the statistics do not depend on the portions in which scenarios were run.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import write_whole
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.figures import plain
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import STATISTIC_KINDS, facts_of, statistic_from
from dualwinch.simulation.ensembles.run import EnsemblePortion, check_counts, portions_of
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.progress import Progress, no_progress

Floats = NDArray[np.float64]


@dataclass
class ValueStream:
    """Exact sum, extremes and approximate quantiles of a stream of finite values (DDSketch).

    Attributes:
        accuracy: maximum relative error of a quantile.
        count: number of values.
        total: their sum.
        bins: sign, and number times sign, of a logarithmic bin → number of values in it.
        lowest, highest: extreme values.
    """

    accuracy: float
    count: int = 0
    total: Fraction = Fraction()
    bins: Counter[tuple[float, float]] = field(default_factory=Counter)
    lowest: float = math.inf
    highest: float = -math.inf

    @property
    def _base(self) -> float:
        """Ratio of the upper to the lower bound of a bin."""
        return (1 + self.accuracy) / (1 - self.accuracy)

    def add(self, values: Floats) -> None:
        """Add values; those that are not finite are ignored."""
        values = values[np.isfinite(values)]
        if not values.size:
            return
        self.count += len(values)
        self.lowest, self.highest = min(self.lowest, float(values.min())), max(self.highest, float(values.max()))
        self.total += sum(map(Fraction, values.tolist()))
        signs, sizes = np.sign(values), np.where(values == 0, 1.0, np.abs(values))
        numbers = signs * np.ceil(np.log(sizes) / math.log(self._base))
        self.bins.update(zip(signs.tolist(), numbers.tolist(), strict=True))

    def merge(self, other: "ValueStream") -> None:
        """Add the values of another stream."""
        self.count += other.count
        self.total += other.total
        self.bins.update(other.bins)
        self.lowest, self.highest = min(self.lowest, other.lowest), max(self.highest, other.highest)

    @property
    def mean(self) -> float:
        """The mean, rounded once."""
        return float(self.total / self.count)

    def quantile(self, share: float) -> float:
        """A quantile, interpolated between two values that are each known to within `accuracy`."""
        rank, bins = share * (self.count - 1), sorted(self.bins)
        upto = np.cumsum([self.bins[each] for each in bins])
        below, above = (
            self._centre(*bins[np.searchsorted(upto, bracket, side="right")])
            for bracket in (math.floor(rank), math.ceil(rank))
        )
        return below + (above - below) * (rank % 1)

    @property
    def geometric_mean(self) -> float:
        """The exponential of the mean logarithm, known to within `accuracy`."""
        counts = np.array(list(self.bins.values()))
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithms = np.log([self._centre(*each) for each in self.bins])
            return float(np.exp(np.average(logarithms, weights=counts)))

    def _centre(self, sign: float, number: float) -> float:
        """The value that represents a bin."""
        value = sign * 2 * self._base ** (sign * number) / (self._base + 1)
        return min(max(value, self.lowest), self.highest)

    def statistic(self, kind: str, *, small_is_bad: bool) -> float:
        """One of `ensembles.result.STATISTIC_KINDS`; NaN without values."""
        if not self.count:
            return math.nan
        match kind:
            case "mean":
                return self.mean
            case "geomean":
                return self.geometric_mean
            case "median":
                return self.quantile(0.5)
            case "p95":
                return self.quantile(0.05 if small_is_bad else 0.95)
            case _:
                return self.lowest if small_is_bad else self.highest


@dataclass(frozen=True, eq=False)
class EnsembleStatistics:
    """Statistics of an ensemble's scenarios, with the interface of `EnsembleResult` except for single scenarios.

    Attributes:
        ensemble: ensemble of the scenarios.
        seed: seed of the draws.
        asked: number of scenarios requested; fewer were run if interrupted.
        outcomes: outcome → number of runs.
        metrics: figure of merit → stream of its values in the completed runs.
    """

    ensemble: Ensemble
    seed: int
    asked: int
    outcomes: Counter[str]
    metrics: dict[str, ValueStream]

    def __len__(self) -> int:
        """Number of scenarios run."""
        return self.outcomes.total()

    def __repr__(self) -> str:
        ends = ", ".join(f"{count} {word}" for word, count in self.outcome_counts.items())
        return f"{type(self).__name__}({self.ensemble.name}: {len(self)} scenarios of seed {self.seed}; {ends})"

    @property
    def partial(self) -> bool:
        """Whether the run was interrupted."""
        return len(self) < self.asked

    @property
    def outcome_counts(self) -> dict[str, int]:
        """Outcome → number of runs, the most frequent first."""
        return dict(self.outcomes.most_common())

    def statistic(self, name: str) -> float:
        """A statistic by name, such as ``worst.mse``, over the completed scenarios; NaN without any.

        Raises:
            ConfigurationError: an unknown statistic or figure of merit.
        """
        statistic = statistic_from(name, self.ensemble.experiment.metrics)
        small_is_bad = statistic.quantity.small_is_bad
        return self.metrics[statistic.metric].statistic(statistic.kind, small_is_bad=small_is_bad)

    @property
    def statistics(self) -> dict[str, dict[str, float]]:
        """Figure of merit → kind of statistic (`STATISTIC_KINDS`) → value."""
        return {
            metric: {kind: self.statistic(f"{kind}.{metric}") for kind in STATISTIC_KINDS} for metric in self.metrics
        }

    def merge(self, other: "EnsembleStatistics") -> None:
        """Add the statistics of other scenarios."""
        self.outcomes.update(other.outcomes)
        for name, stream in other.metrics.items():
            self.metrics[name].merge(stream)

    def save(self, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
        """Write the statistics and their provenance as JSON; the file appears whole or not at all.

        Raises:
            OSError: the file cannot be written.
        """
        units = {name: quantity.unit for name, quantity in metric_quantities(self.ensemble.experiment.metrics).items()}
        facts = plain({**facts_of(self, notes or {}), "units": units, "scenarios": len(self)})
        write_whole(Path(path), json.dumps(facts, indent=1, allow_nan=False) + "\n")


def ensemble_statistics(
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    accuracy: float = 1e-3,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> EnsembleStatistics:
    """Run scenarios of an ensemble like `run_ensemble`, and keep only their statistics.

    Mean and worst are exact, the mean rounded once; quantiles are within `accuracy` of a value. Memory is the same for
    a thousand scenarios and for a million.

    Args:
        ensemble: ensemble of the scenarios.
        scenarios: number of scenarios.
        seed: seed of the draws.
        accuracy: maximum relative error of a quantile.
        workers: number of threads on this machine (default: one per core), or an executor.
        progress: called with the fraction of finished scenarios.

    Raises:
        ConfigurationError: a count or seed out of range, or inconsistent values.
        DualwinchError: no compiler or no usable cache folder.
        KeyboardInterrupt: before the first scenario was finished.

    Example:
        >>> import dualwinch as dw
        >>> sea = dw.load_ensemble("sea", dw.override(dw.Experiment(), {"simulation.duration": 2.0}))
        >>> statistics = dw.ensemble_statistics(sea, scenarios=50, seed=0)
        >>> statistics.outcome_counts
        {'completed': 50}
    """
    if not 0 < accuracy < 1:
        raise ConfigurationError(f"accuracy = {accuracy:g}: must be > 0 and < 1")
    check_counts([ensemble], scenarios, seed)
    result = _none(ensemble, seed, scenarios, accuracy)
    statistics = partial(portion_statistics, ensemble, seed, accuracy)
    with suppress(KeyboardInterrupt):
        for portion in portions_of([ensemble], scenarios, seed, 0, workers, progress, statistics):
            result.merge(portion)
    if not len(result):
        raise KeyboardInterrupt
    return result


def _none(ensemble: Ensemble, seed: int, asked: int, accuracy: float) -> EnsembleStatistics:
    streams = {name: ValueStream(accuracy) for name in metric_quantities(ensemble.experiment.metrics)}
    return EnsembleStatistics(ensemble, seed, asked, Counter(), streams)


def portion_statistics(ensemble: Ensemble, seed: int, accuracy: float, portion: EnsemblePortion) -> EnsembleStatistics:
    """The statistics of a portion of an ensemble's scenarios."""
    (runs,) = portion.runs
    statistics = _none(ensemble, seed, len(runs.outcomes), accuracy)
    statistics.outcomes.update(runs.outcomes.tolist())
    for name, stream in statistics.metrics.items():
        stream.add(runs.of_completed(name))
    return statistics
