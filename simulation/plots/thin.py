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
    drawable = np.where(np.abs(values) <= LARGEST, values, np.nan)
    if len(t) <= 4 * columns:
        return t, drawable
    block = -(-len(t) // columns)
    places = np.arange(-(-len(t) // block) * block).clip(max=len(t) - 1).reshape(-1, block)
    blocks = drawable[places]
    missing = np.isnan(blocks)
    lowest = np.argmin(np.where(missing, np.inf, blocks), axis=1)
    highest = np.argmax(np.where(missing, -np.inf, blocks), axis=1)
    rows = np.arange(len(places))
    kept = np.concatenate(([0, len(t) - 1], places[rows, lowest], places[rows, highest]))
    kept = np.unique(kept)
    return t[kept], drawable[kept]


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
    place = ((t - t[0]) / width).astype(int)
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    size = np.abs(np.where(np.abs(values) <= LARGEST, values, np.nan))
    largest = np.fmax.reduceat(size, starts)
    return t[0] + (place[starts] + 0.5) * width, np.where(largest > 0, largest, np.nan)
