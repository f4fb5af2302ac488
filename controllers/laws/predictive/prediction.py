"""What is predicted: a mass whose acceleration goes from instant to instant of the horizon along straight lines."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

GROWTH = 1.6
"""Each stage is so many times as long as the one before: what is near is shaped finely."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Instants and what a change of acceleration at one of them does to the motion at all.

    Attributes:
        lengths: (n,) of the stages in s.
        times: (n,) of their ends in s.
        weights: (n,) time in s that an end stands for, by the trapezoidal rule.
        of_position, of_speed: (n, n) change of position in m and of speed in m/s at each end, by the acceleration in
            m/s² at each; lower triangular.
        of_change: (n, n) sum over the stages of squared changes of acceleration over length, as a quadratic form.
    """

    lengths: Floats
    times: Floats
    weights: Floats
    of_position: Floats
    of_speed: Floats
    of_change: Floats


@cache
def prediction(horizon: float, stages: int) -> Prediction:
    """The prediction over a horizon in s."""
    growing = GROWTH ** np.arange(stages)
    lengths = horizon * growing / growing.sum()
    position, speed = np.zeros((stages, stages)), np.zeros((stages, stages))
    before = np.eye(stages, k=-1)
    x = v = np.zeros(stages)
    for k, (h, last, now) in enumerate(zip(lengths, before, np.eye(stages), strict=True)):
        x = x + h * v + h**2 * (last / 3 + now / 6)
        v = v + h * (last + now) / 2
        position[k], speed[k] = x, v
    difference = np.eye(stages) - before
    return Prediction(
        lengths=lengths,
        times=np.cumsum(lengths),
        weights=(lengths + np.append(lengths[1:], 0.0)) / 2,
        of_position=position,
        of_speed=speed,
        of_change=difference.T @ np.diag(1 / lengths) @ difference,
    )
