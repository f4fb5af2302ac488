"""A named statistic of a figure of merit over scenarios: ``mean.mse``, ``p95.chatter``, ``worst.peak_tension``."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Quantity, nearest
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import BUILT_IN, Metrics

SMALL_IS_BAD = frozenset({"min_tension"})
"""Built-in figures of merit whose bad end is the small one; of the others it is the large one."""

KINDS = ("mean", "median", "p95", "worst")
"""What a statistic can be: ``p95``: 95 % of the scenarios are no worse; ``worst``: the extreme at the bad end."""


@dataclass(frozen=True)
class Statistic:
    """One statistic of one figure of merit.

    Attributes:
        kind: one of `KINDS`.
        metric: name of the figure of merit.
        own: what computes it, where it is none of the built-in ones.
    """

    kind: str
    metric: str
    own: Metric | None = None

    @property
    def name(self) -> str:
        """Such as ``mean.mse``."""
        return f"{self.kind}.{self.metric}"

    @property
    def quantity(self) -> Quantity:
        """Unit and meaning of the figure of merit."""
        return self.own.quantity if self.own else describe(Metrics)[self.metric].quantity

    @property
    def unit(self) -> str:
        """Unit of the figure of merit."""
        return self.quantity.unit

    @property
    def small_is_bad(self) -> bool:
        """Whether the figure of merit's bad end is the small one."""
        return self.own.small_is_bad if self.own else self.metric in SMALL_IS_BAD

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


def statistic_from(text: str, own: Sequence[Metric] = ()) -> Statistic:
    """The statistic of a name; a figure of merit alone means its mean.

    Args:
        text: the name.
        own: the experiment's own metrics.

    Raises:
        ConfigurationError: unknown statistic or figure of merit.
    """
    kind, dot, metric = text.strip().rpartition(".")
    if not dot:
        kind = "mean"
    if kind not in KINDS:
        raise ConfigurationError(f"'{text.strip()}': unknown statistic '{kind}'; must be {', '.join(KINDS)}")
    parts = {part.table(): part for part in own}
    known = (*BUILT_IN, *parts)
    if metric not in known:
        raise ConfigurationError(
            f"'{text.strip()}': unknown metric '{metric}'; did you mean '{nearest(metric, known)}'?"
        )
    return Statistic(kind, metric, parts.get(metric))
