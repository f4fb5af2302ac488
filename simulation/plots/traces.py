"""Points of a run's lines: long traces thinned without losing peaks, and peaks of intervals."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PIXEL_COLUMNS = 900
"""Pixel columns of the widest panel on a screen: more instants of a signal are not seen."""

LARGEST_DRAWN = 1e12
"""Magnitude beyond which values, of diverged runs, are not drawn."""


def thin(t: Floats, values: Floats, columns: int = PIXEL_COLUMNS) -> tuple[Floats, Floats]:
    """Thin a signal to the smallest and the largest value of every pixel column, and both ends.

    Times, ascending, and values are (rows,); NaN where the signal has none. Short signals are kept whole.
    """
    finite_values = drawable(values)
    if len(t) <= 4 * columns:
        return t, finite_values
    block = -(-len(t) // columns)
    indices = np.arange(-(-len(t) // block) * block).clip(max=len(t) - 1).reshape(-1, block)
    blocks = finite_values[indices]
    gaps = np.isnan(blocks)
    lowest = np.argmin(np.where(gaps, np.inf, blocks), axis=1)
    highest = np.argmax(np.where(gaps, -np.inf, blocks), axis=1)
    rows = np.arange(len(indices))
    indices_of_line = np.concatenate(([0, len(t) - 1], indices[rows, lowest], indices[rows, highest]))
    indices_of_line = np.unique(indices_of_line)
    return t[indices_of_line], finite_values[indices_of_line]


def drawable(values: Floats) -> Floats:
    """A signal with NaN in place of values beyond `LARGEST_DRAWN`."""
    return np.where(np.abs(values) <= LARGEST_DRAWN, values, np.nan)


def largest(values: Floats) -> float:
    """The largest drawable magnitude of a signal; 0 if there is none."""
    return float(np.nanmax(np.abs(drawable(values)), initial=0.0))


def within(t: Floats, start: float, end: float) -> slice:
    """The rows with times from `start` to `end`, both in the unit of `t`."""
    return slice(int(np.searchsorted(t, start, "left")), int(np.searchsorted(t, end, "right")))


def peaks(t: Floats, values: Floats, width: float) -> tuple[Floats, Floats]:
    """Largest magnitude in each interval of a width in s, at the interval's middle; NaN where it is zero or missing.

    Times in ascending order and values are (rows,).
    """
    if not len(t):
        return t, values
    interval = ((t - t[0]) / width).astype(int)
    starts = np.flatnonzero(np.diff(interval, prepend=-1))
    peak = np.fmax.reduceat(np.abs(drawable(values)), starts)
    return t[0] + (interval[starts] + 0.5) * width, np.where(peak > 0, peak, np.nan)
