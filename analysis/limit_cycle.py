"""The limit cycle in which a loop ends that is unstable at small amplitudes, by its describing functions."""

import math
from dataclasses import dataclass

from dualwinch.analysis.describing_function import AmplitudePoint, amplitude_sweep
from dualwinch.analysis.remarks import NOT_COMPUTABLE
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.style import length_unit


@dataclass(frozen=True)
class LimitCycle:
    """An oscillation that neither grows nor decays.

    Attributes:
        speed: amplitude of the speed error in m/s.
        frequency: in Hz.
        noise: standard deviation of the speed sensor's noise in m/s.
    """

    speed: float
    frequency: float
    noise: float

    @property
    def position(self) -> float:
        """Amplitude of the position error in m."""
        return self.speed / (2 * math.pi * self.frequency)

    @property
    def words(self) -> str:
        """Its size and frequency, and whether it matters, in words."""
        unit, name = length_unit(self.position)
        size = f"a cycle of {self.position / unit:.2g} {name} at {self.frequency:.2g} Hz"
        if self.speed <= self.noise:
            return f"{size}, in which the speed changes by less than its sensor's noise: harmless"
        return f"{size}, larger than the speed sensor's noise"


def limit_cycle(experiment: Experiment) -> LimitCycle | None:
    """The stable limit cycle of a loop at rest at mid-track, by the describing functions of the sliding-mode law.

    The loop is unstable below an amplitude of the speed error and stable above it; oscillations of that amplitude
    neither grow nor decay (Khalil, Nonlinear Systems, 2002, Section 7.2). The amplitude is the smallest stable one of a
    grid.

    Returns:
        The cycle; ``None`` if the loop is stable at small amplitudes, unstable at all, or has no describing function.
    """
    try:
        points = amplitude_sweep(experiment)
    except NOT_COMPUTABLE:
        return None
    unstable = [index for index, point in enumerate(points) if not point.margins.stable]
    if not unstable or unstable[0] > 0 or unstable[-1] + 1 == len(points):
        return None
    edge = points[unstable[-1] + 1]
    frequency = _frequency(edge)
    if not (math.isfinite(frequency) and frequency > 0):
        return None
    return LimitCycle(edge.amplitude, frequency / (2 * math.pi), experiment.sensors.speed_noise)


def _frequency(point: AmplitudePoint) -> float:
    """Angular frequency in rad/s of a loop near its stability limit: that of the nearer gain margin."""
    margins = point.margins
    above = math.log(margins.gain) if 0 < margins.gain < math.inf else math.inf
    below = -math.log(margins.least_gain) if margins.least_gain > 0 else math.inf
    return margins.gain_frequency if above <= below else margins.least_gain_frequency
