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
        own = np.array([_correlation(values, values, lag) for lag in range(1, LAGS + 1)])
        by = np.array([
            max((_correlation(_changes(torques, side), values, lag) for side in (0, 1)), key=abs)
            for lag in range(1, LAGS + 1)
        ])  # fmt: skip
        most, torque = int(np.argmax(np.abs(own))), int(np.argmax(np.abs(by)))
        found.append(Whiteness(name, count, variance, float(own[most]), most + 1, float(by[torque]), torque + 1))
    return tuple(found)


def _changes(torques: Sequence[Floats], side: int) -> list[Floats]:
    return [np.diff(each[:, side], prepend=each[0, side]) for each in torques]


def _correlation(first: Sequence[Floats], second: Sequence[Floats], lag: int) -> float:
    """Correlation of what is first with what is second, `lag` samples later."""
    early = np.concatenate([each[:-lag] for each in first])
    late = np.concatenate([each[lag:] for each in second])
    both = np.isfinite(early) & np.isfinite(late)
    size = np.sqrt((early[both] ** 2).sum() * (late[both] ** 2).sum())
    return float((early[both] * late[both]).sum() / size) if size > 0 else 0.0
