"""How the values of a key lie along an axis: words and switches in their order, numbers evenly or by factors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SPAN = 10
"""Numbers whose largest is fewer times the smallest lie evenly."""

LABELLED = 9
"""Most numbers that each have a tick of their own."""


@dataclass(frozen=True)
class SweptAxis:
    """An axis.

    Attributes:
        order: indices of the values along the axis.
        positions: (n,) of the values in that order.
        words: what stands at each; empty where the axis has numbers of its own.
        log: whether factors count, not differences.
        categorical: whether what lies in between means nothing.
    """

    order: NDArray[np.int64]
    positions: Floats
    words: tuple[str, ...]
    log: bool
    categorical: bool = False

    @property
    def edges(self) -> Floats:
        """(n + 1,) ends of the cells around the values."""
        at = np.log(self.positions) if self.log else self.positions
        if len(at) == 1:
            half = 0.5 * (abs(at[0]) or 1.0)
            inner, first, last = np.empty(0), at[0] - half, at[0] + half
        else:
            inner = (at[1:] + at[:-1]) / 2
            first, last = 2 * at[0] - inner[0], 2 * at[-1] - inner[-1]
        edges = np.concatenate(([first], inner, [last]))
        return np.exp(edges) if self.log else edges

    def draw(self, axes: Axes, side: Literal["x", "y"], label: str) -> None:
        """Set scale, ticks and label of one of a panel's axes."""
        axes.set(**{f"{side}label": label} | ({f"{side}scale": "log"} if self.log else {}))
        axis = axes.xaxis if side == "x" else axes.yaxis
        if self.words:
            axis.set_ticks(self.positions.tolist(), self.words)
            axis.set_minor_locator(NullLocator())


def swept_axis(values: Sequence[Any]) -> SweptAxis:
    """The axis of a key's values."""
    if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        words = tuple("–" if value is None else str(value).lower() for value in values)
        order = np.arange(len(values))
        return SweptAxis(order, order.astype(float), words, log=False, categorical=True)
    order = np.argsort(values)
    positions = np.array(values, float)[order]
    words = tuple(f"{value:.4g}" for value in positions) if len(positions) <= LABELLED else ()
    return SweptAxis(order, positions, words, log=grows_by_factors(positions))


def grows_by_factors(ascending: Floats) -> bool:
    """Whether the steps between numbers are more even as factors than as differences."""
    if len(ascending) < 3 or ascending[0] <= 0 or ascending[-1] < SPAN * ascending[0]:
        return False
    factors, differences = np.diff(np.log(ascending)), np.diff(ascending)
    return bool(np.ptp(factors) / factors.mean() < np.ptp(differences) / differences.mean())


def spans_decades(values: Floats) -> bool:
    """Whether measured values, NaN among them, are told apart on a logarithmic scale only."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() >= 3 * SPAN * finite.min())
