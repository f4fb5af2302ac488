"""Fewer points for the same picture: what a line of a given width in pixels can show, peaks included."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

COLUMNS = 900
"""Pixel columns of the widest panel on a screen; each keeps its smallest and its largest value."""

LARGEST = 1e12
"""Values beyond this, of runs that diverged, are not drawn: no axis could show them."""


def thin(t: Floats, values: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """Keep the smallest and the largest value of every pixel column, and both ends.

    Args:
        t: (rows,) times in ascending order.
        values: (rows,) signal; NaN where it has none.
        columns: pixel columns the line will span.

    Returns:
        Times and values of the points kept, in their order; all of them where they are few.
    """
    drawn = drawable(values)
    if len(t) <= 4 * columns:
        return t, drawn
    block = -(-len(t) // columns)
    indices = np.arange(-(-len(t) // block) * block).clip(max=len(t) - 1).reshape(-1, block)
    blocks = drawn[indices]
    missing = np.isnan(blocks)
    lowest = np.argmin(np.where(missing, np.inf, blocks), axis=1)
    highest = np.argmax(np.where(missing, -np.inf, blocks), axis=1)
    rows = np.arange(len(indices))
    kept = np.concatenate(([0, len(t) - 1], indices[rows, lowest], indices[rows, highest]))
    kept = np.unique(kept)
    return t[kept], drawn[kept]


def drawable(values: Floats) -> Floats:
    """A signal with NaN in place of what no axis could show."""
    return np.where(np.abs(values) <= LARGEST, values, np.nan)


def largest(values: Floats) -> float:
    """The largest magnitude of a signal that can be drawn; 0 where there is none."""
    return float(np.nanmax(np.abs(drawable(values)), initial=0.0))


def within(t: Floats, start: float, end: float) -> slice:
    """The rows whose time lies from `start` to `end`, both in the unit of `t`."""
    return slice(int(np.searchsorted(t, start, "left")), int(np.searchsorted(t, end, "right")))


def peaks(t: Floats, values: Floats, width: float) -> tuple[Floats, Floats]:
    """Largest magnitude in each interval of a `width`, at the interval's middle; NaN where it is zero or missing.

    Args:
        t: (rows,) times in ascending order.
        values: (rows,) signal.
        width: of an interval, in the unit of `t`.
    """
    if not len(t):
        return t, values
    interval = ((t - t[0]) / width).astype(int)
    starts = np.flatnonzero(np.diff(interval, prepend=-1))
    peak = np.fmax.reduceat(np.abs(drawable(values)), starts)
    return t[0] + (interval[starts] + 0.5) * width, np.where(peak > 0, peak, np.nan)
