"""Whether what is left is noise: the whitened surprises of each sensor, tested."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from dualwinch.identification.sensed import READINGS

Floats = NDArray[np.float64]

LAGS = 50
"""Lags in samples that are looked at."""

CONFIDENCE = 0.99
"""Of all tests of a sensor together, by Bonferroni."""

SMALL = 0.05
"""A correlation that does not matter, even where there are so many readings that it is no chance."""


@dataclass(frozen=True)
class Whiteness:
    """What is left of a sensor.

    Attributes:
        name: of the reading.
        count: readings.
        variance: of the whitened surprises; 1 where the model is right.
        correlation, lag: the largest autocorrelation in magnitude, and after how many samples.
        by_torque, torque_lag: the largest correlation with a change of the torques, and how many samples later.
    """

    name: str
    count: int
    variance: float
    correlation: float
    lag: int
    by_torque: float
    torque_lag: int

    @property
    def bound(self) -> float:
        """Magnitude below which a correlation may be chance."""
        return float(norm.ppf(1 - (1 - CONFIDENCE) / (2 * LAGS)) / np.sqrt(max(self.count, 1)))

    @property
    def white(self) -> bool:
        """Whether nothing is left that matters."""
        return max(abs(self.correlation), abs(self.by_torque)) <= max(self.bound, SMALL)


def whiteness(surprises: Sequence[Floats], torques: Sequence[Floats]) -> tuple[Whiteness, ...]:
    """The tests of every sensor that was read.

    Args:
        surprises: of each section, (samples, readings), whitened; NaN where nothing was read.
        torques: of each section, (samples, 2).
    """
    found = []
    for column, name in enumerate(READINGS):
        values = [section[:, column] for section in surprises]
        count = sum(int(np.isfinite(each).sum()) for each in values)
        if count < 2 * LAGS:
            continue
        variance = sum(float(np.nansum(each**2)) for each in values) / count
        own = _correlations(values, values)
        sides = np.array([_correlations(_changes(torques, side), values) for side in (0, 1)])
        by = np.where(np.abs(sides[0]) >= np.abs(sides[1]), *sides)
        most, torque = int(np.argmax(np.abs(own))), int(np.argmax(np.abs(by)))
        found.append(Whiteness(name, count, variance, float(own[most]), most + 1, float(by[torque]), torque + 1))
    return tuple(found)


def _changes(torques: Sequence[Floats], side: int) -> list[Floats]:
    return [np.diff(each[:, side], prepend=each[0, side]) for each in torques]


def _correlations(first: Sequence[Floats], second: Sequence[Floats]) -> Floats:
    """Correlation of what is first with what is second, 1 to `LAGS` samples later; (lags,)."""
    sums = np.zeros((3, LAGS))
    for early, late in zip(first, second, strict=True):
        known, there = np.isfinite(early), np.isfinite(late)
        a, b = np.where(known, early, 0.0), np.where(there, late, 0.0)
        pairs = (a, b), (a**2, there.astype(float)), (known.astype(float), b**2)
        sums += [[np.einsum("i,i->", x[:-lag], y[lag:]) for lag in range(1, LAGS + 1)] for x, y in pairs]
    products, size = sums[0], np.sqrt(sums[1] * sums[2])
    return np.divide(products, size, out=np.zeros(LAGS), where=size > 0)
