"""A recorded motion: a smooth curve through the positions of a file."""

from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.motions.setpoint import Setpoint
from dualwinch.model.scalar import Scalar
from dualwinch.model.signals.recording import Recording

Floats = NDArray[np.float64]

EQUAL = 1e-6
"""Share of the largest speed by which two speeds may differ and be the same: numbers of files are rounded."""

MOVING = 1e-3
"""Share of the largest speed below which the vehicle stands."""


class RecordedMotion:
    """A curve through recorded positions, with its speed and its acceleration.

    Through positions alone it is the cubic spline whose speed and acceleration are continuous. Where speeds are
    recorded too, it is the cubic curve through both, whose acceleration may step at a row. A recorded acceleration
    stands in place of the curve's own, in straight lines from row to row. Before the first row and after the last the
    vehicle rests where the row says.
    """

    def __init__(self, t: Floats, x: Floats, v: Floats | None = None, a: Floats | None = None) -> None:
        """Lay the curve.

        Args:
            t: (n,) times in s, ascending.
            x: (n,) positions in m.
            v: (n,) speeds in m/s.
            a: (n,) accelerations in m/s².
        """
        from scipy.interpolate import CubicHermiteSpline, CubicSpline

        self.t, self.x, self.a = t, x, a
        self._curve: Any = CubicSpline(t, x) if v is None else CubicHermiteSpline(t, x, v)

    def at(self, t: Scalar) -> Setpoint:
        """Position, speed and acceleration at the time t in s, a float or an array."""
        times = np.asarray(t, float)
        within = (times >= self.t[0]) & (times <= self.t[-1])
        inside = times.clip(self.t[0], self.t[-1])
        a = self._curve(inside, 2) if self.a is None else np.interp(inside, self.t, self.a)
        return Setpoint(self._curve(inside), np.where(within, self._curve(inside, 1), 0.0), np.where(within, a, 0.0))

    @cached_property
    def longest_cruise(self) -> tuple[float, float] | None:
        """First and last time in s of the longest stretch of rows at one speed; ``None`` where there is none."""
        speeds = np.diff(self.x) / np.diff(self.t)
        largest = np.abs(speeds).max()
        same = (np.abs(np.diff(speeds)) <= EQUAL * largest) & (np.abs(speeds[1:]) > MOVING * largest)
        ends = np.flatnonzero(np.diff(np.concatenate(([0], same.astype(int), [0]))))
        stretches = [(float(self.t[first]), float(self.t[last + 1])) for first, last in ends.reshape(-1, 2)]
        return max(stretches, key=lambda stretch: stretch[1] - stretch[0], default=None)


@lru_cache(maxsize=16)
def recorded_motion(
    recording: Recording, units: tuple[str | None, ...], derivatives: tuple[str, ...]
) -> RecordedMotion:
    """The motion of a recording.

    Args:
        recording: positions, and speeds and accelerations where it has them.
        units: of its columns; ``None``: as the file says.
        derivatives: SI units of its columns, of ``m``, ``m/s`` and ``m/s^2`` those that there are.

    Raises:
        ConfigurationError: a unit is not stated, or is of another quantity.
    """
    found = {
        si: recording.column(index, unit, si) for index, (unit, si) in enumerate(zip(units, derivatives, strict=True))
    }
    return RecordedMotion(recording.t, found["m"], found.get("m/s"), found.get("m/s^2"))
