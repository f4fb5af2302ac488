"""A named statistic of a figure of merit over the scenarios: ``mean.mse``, ``worst.peak_tension``."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.description import describe
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantity import nearest
from dualwinch.simulation.ensembles.result import METRICS, SMALL_IS_BAD
from dualwinch.simulation.loop.metrics import Metrics

KINDS = ("mean", "median", "p95", "worst")

UNMEASURED = 1e9
"""What stands for a statistic of no completed scenario: finite, as every storage wants it."""


@dataclass(frozen=True)
class Statistic:
    """One statistic of one figure of merit.

    Attributes:
        kind: ``mean``, ``median``, ``p95`` (95 % of the scenarios are no worse) or ``worst``.
        metric: name in `simulation.loop.metrics.Metrics`.
    """

    kind: str
    metric: str

    @property
    def name(self) -> str:
        """Such as ``mean.mse``."""
        return f"{self.kind}.{self.metric}"

    @property
    def unit(self) -> str:
        """Unit of the figure of merit."""
        return describe(Metrics)[self.metric].quantity.unit

    @property
    def small_is_bad(self) -> bool:
        """Whether the figure of merit's bad end is the small one."""
        return self.metric in SMALL_IS_BAD

    def over(self, values: NDArray[np.float64]) -> float:
        """The statistic over the scenarios that were completed, NaN left out; `UNMEASURED` without any."""
        values = values[np.isfinite(values)]
        if not len(values):
            return -UNMEASURED if self.small_is_bad else UNMEASURED
        match self.kind:
            case "mean":
                found = values.mean()
            case "median":
                found = np.median(values)
            case "p95":
                found = np.quantile(values, 0.05 if self.small_is_bad else 0.95)
            case _:
                found = values.min() if self.small_is_bad else values.max()
        return float(np.clip(found, -UNMEASURED, UNMEASURED))


def statistic_from(text: str) -> Statistic:
    """The statistic of a name; a figure of merit alone means its mean.

    Raises:
        ConfigurationError: unknown statistic or figure of merit.
    """
    kind, dot, metric = text.strip().rpartition(".")
    if not dot:
        kind = "mean"
    if kind not in KINDS:
        raise ConfigurationError(f"'{text.strip()}': unknown statistic '{kind}'; must be {', '.join(KINDS)}")
    if metric not in METRICS:
        raise ConfigurationError(
            f"'{text.strip()}': unknown metric '{metric}'; did you mean '{nearest(metric, METRICS)}'?"
        )
    return Statistic(kind, metric)
