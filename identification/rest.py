"""Where a machine stands still: friction that may point either way tells a filter less than it believes.

A filter takes friction for a slope at what it expects of the speed. Which way friction points on a drum that sticks,
and how far below its limit, nobody knows; a slope there makes up what the log does not tell.
"""

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.sensed import READINGS
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

SLOW = 0.05
"""Speed in m/s below which a machine counts as at rest."""

WINDOW = 0.5
"""Time in s over which a speed is taken."""

SHORTEST_MOVE, LEAST = 2.0, 5.0
"""Length in s of a stretch under way, and of all of them together, below which they are not looked at alone."""


def stretches(readings: Floats, experiment: Experiment) -> list[slice]:
    """Samples under way, stretch by stretch; all of them where nothing sticks, or hardly anything moves.

    Args:
        readings: (samples, readings) of `identification.course.samples_of`.
        experiment: what is believed; gives friction, drum radii and sample time.
    """
    winches, step = (experiment.plant.winch_1, experiment.plant.winch_2), experiment.simulation.sample_time
    whole = [slice(0, len(readings))]
    if not any(winch.coulomb_friction for winch in winches):
        return whole
    positions = {"theta_1": winches[0].drum_radius, "theta_2": winches[1].drum_radius, "x": 1.0}
    for name, radius in positions.items():
        values = radius * readings[:, READINGS.index(name)]
        known = np.flatnonzero(np.isfinite(values))
        if len(known) > 1:
            break
    else:
        return whole
    half = max(1, round(WINDOW / 2 / step))
    along = np.interp(np.arange(-half, len(values) + half), known, values[known])
    fast = np.abs(along[2 * half :] - along[: -2 * half]) > SLOW * 2 * half * step
    edges = np.flatnonzero(np.diff(fast.astype(int), prepend=0, append=0))
    found = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2) if (b - a) * step >= SHORTEST_MOVE]
    return found if sum(each.stop - each.start for each in found) * step >= LEAST else whole
