"""How noisy each sensor is to begin with: what the experiment says, else what the log's own jumps say."""

import math

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.sensed import READINGS
from dualwinch.simulation.sensors import Sensors

Floats = NDArray[np.float64]

FINEST = {
    "x": 1e-5,
    "v": 1e-5,
    "F1": 0.1,
    "F2": 0.1,
    "theta_1": 1e-6,
    "theta_2": 1e-6,
    "omega_1": 1e-4,
    "omega_2": 1e-4,
}
"""Least standard deviation of each sensor: none is perfect, and the model is not either."""

NORMAL_MEDIAN = 0.6745
"""Median of a standard normal number's magnitude."""


def first_noise(readings: Floats, sensors: Sensors) -> Floats:
    """Variances of all sensors to begin with, (readings,).

    What the experiment gives, steps among it; for what it takes for perfect, the log's own jumps from sample to sample:
    third differences leave next to nothing of a motion.

    Args:
        readings: (samples, readings) of `identification.course.samples_of`.
        sensors: the experiment's.
    """
    given = {
        "x": math.hypot(sensors.position_noise, sensors.position_resolution / math.sqrt(12)),
        "v": sensors.speed_noise,
        "F1": sensors.tension_noise,
        "F2": sensors.tension_noise,
    }
    found = []
    for name, least in zip(READINGS, smallest_noise(readings).tolist(), strict=True):
        believed = given.get(name, 0.0)
        found.append((max(believed, FINEST[name]) if believed > 0 else least) ** 2)
    return np.array(found)


def smallest_noise(readings: Floats) -> Floats:
    """Standard deviations of all sensors, (readings,), by their own jumps from sample to sample alone."""
    return np.array([
        max(_jumps(values[np.isfinite(values)]), FINEST[name])
        for name, values in zip(READINGS, readings.T, strict=True)
    ])  # fmt: skip


def _jumps(values: Floats) -> float:
    """Standard deviation of white noise, by third differences; of what counts in steps at least that of rounding."""
    if len(values) < 10:
        return 0.0
    steps = np.abs(np.diff(values))
    least = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
    spread = float(np.median(np.abs(np.diff(values, 3)))) / NORMAL_MEDIAN / math.sqrt(20)
    in_steps = least > 0 and np.allclose(np.rint(steps / least), steps / least, atol=1e-3)
    return max(spread, least / math.sqrt(12)) if in_steps else spread
