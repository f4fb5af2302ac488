"""A named statistic of a figure of merit over scenarios: ``mean.mse``, ``p95.chatter``, ``worst.peak_tension``."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import nearest
from dualwinch.simulation.loop.metrics import Metrics

METRICS = tuple(field.name for field in fields(Metrics))
"""Names of the figures of merit."""

SMALL_IS_BAD = frozenset({"min_tension"})
"""Figures of merit whose bad end is the small one; of all others it is the large one."""

KINDS = ("mean", "median", "p95", "worst")
"""What a statistic can be: ``p95``: 95 % of the scenarios are no worse; ``worst``: the extreme at the bad end."""


@dataclass(frozen=True)
class Statistic:
    """One statistic of one figure of merit.

    Attributes:
        kind: one of `KINDS`.
        metric: one of `METRICS`.
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
        """The statistic over the figure of merit of some scenarios (n,), what is not finite left out; NaN without any.

        A run that ended early measured something else: give the values of completed scenarios alone.
        """
        values = values[np.isfinite(values)]
        if not len(values):
            return np.nan
        match self.kind:
            case "mean":
                return float(values.mean())
            case "median":
                return float(np.median(values))
            case "p95":
                return float(np.quantile(values, 0.05 if self.small_is_bad else 0.95))
            case _:
                return float(values.min() if self.small_is_bad else values.max())


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
