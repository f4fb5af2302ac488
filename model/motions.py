"""Motions of a reference: setpoints with their preview, S-curves, moves through way-points, recorded motions.

A setpoint alone implies a motion of constant acceleration. A part of the controller may request a preview: setpoints at
some times ahead. Its signals are the deviations from constant acceleration, which are zero at constant speed, so that
steady motion needs no preview.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.recordings import Recording
from dualwinch.model.scalar import Scalar, maximum, sqrt, where


@dataclass(frozen=True)
class Setpoint:
    """Reference position, speed and acceleration of the vehicle."""

    x: Annotated[Scalar, Quantity("m", "reference position")]
    v: Annotated[Scalar, Quantity("m/s", "reference speed")]
    a: Annotated[Scalar, Quantity("m/s^2", "reference acceleration")]

    def ahead(self, by: Scalar) -> "Setpoint":
        """Setpoint a time in s later at constant acceleration; `model.motions.Previewed` has the true one."""
        return Setpoint(self.x + by * (self.v + by / 2 * self.a), self.v + by * self.a, self.a)


def piece_at(t: Scalar, pieces: Sequence[tuple[Scalar, Setpoint]], last: Setpoint) -> Setpoint:
    """The first piece with an end at or after t, else `last`, which has no end."""
    setpoint = last
    for end, piece in reversed(pieces):
        setpoint = Setpoint(
            x=where(t <= end, piece.x, setpoint.x),
            v=where(t <= end, piece.v, setpoint.v),
            a=where(t <= end, piece.a, setpoint.a),
        )
    return setpoint


@dataclass(frozen=True)
class Departures:
    """Deviations of a motion, at k times ahead, from constant acceleration: vectors (k,)."""

    x: Annotated[Any, Quantity("m", "deviation of the future reference position from constant acceleration")]
    v: Annotated[Any, Quantity("m/s", "deviation of the future reference speed from constant acceleration")]
    a: Annotated[Any, Quantity("m/s^2", "deviation of the future reference acceleration from the present one")]


def no_departures(times: Sequence[float]) -> Departures:
    """Deviations of zero: constant acceleration."""
    return Departures(*(np.zeros(len(times)) for _ in range(3)))


@dataclass(frozen=True)
class Previewed(Setpoint):
    """A setpoint, and the setpoints at some times ahead."""

    known: Annotated[Mapping[float, Setpoint], Mark.CONTENT] = field(default_factory=dict)

    def ahead(self, by: float) -> Setpoint:
        """Setpoint a time in s later.

        Raises:
            ConfigurationError: the time is not in a preview.
        """
        if by not in self.known:
            times = ", ".join(f"{time:g}" for time in self.known) or "none"
            raise ConfigurationError(f"setpoint.ahead({by}): must be a time of the part's preview, {times}")
        return self.known[by]


def previewed(setpoint: Setpoint, times: Sequence[float], departures: Departures | None = None) -> Previewed:
    """A setpoint with those at some times ahead in s; without departures at constant acceleration."""
    setpoints = {}
    for index, time in enumerate(times):
        point = setpoint.ahead(time)
        if departures is not None:
            by = departures.x[index], departures.v[index], departures.a[index]
            point = Setpoint(point.x + by[0], point.v + by[1], point.a + by[2])
        setpoints[time] = point
    return Previewed(setpoint.x, setpoint.v, setpoint.a, setpoints)


def least_duration(speed: Scalar, jerk_limit: Scalar) -> Scalar:
    """Shortest time in s from rest to a speed in m/s with a jerk limit in m/s³."""
    return 2 * sqrt(speed / jerk_limit)


def speed_up(t: Scalar, duration: Scalar, speed: Scalar, jerk_limit: Scalar | None) -> Setpoint:
    """Motion from rest at t = 0 to a speed in m/s in a given time, over ``speed * duration / 2`` with any jerk limit.

    The duration in s is at least `least_duration`. The jerk limit in m/s³ is the slope of the acceleration's two ramps;
    ``None``: constant acceleration.
    """
    if jerk_limit is None:
        acceleration = speed / duration
        return Setpoint(acceleration * t**2 / 2, acceleration * t, acceleration)
    # ramp * (duration - ramp) * jerk_limit = speed, solved without cancellation
    spare = maximum(duration**2 - 4 * speed / jerk_limit, 0.0)
    ramp = 2 * speed / jerk_limit / (duration + sqrt(spare))
    acceleration, after, remaining_time = jerk_limit * ramp, t - ramp, duration - t
    rising = Setpoint(jerk_limit * t**3 / 6, jerk_limit * t**2 / 2, jerk_limit * t)
    gained = jerk_limit * ramp**2 / 2
    steady = Setpoint(
        gained * ramp / 3 + gained * after + acceleration * after**2 / 2, gained + acceleration * after, acceleration
    )
    falling = Setpoint(
        speed * duration / 2 - speed * remaining_time + jerk_limit * remaining_time**3 / 6,
        speed - jerk_limit * remaining_time**2 / 2,
        jerk_limit * remaining_time,
    )
    return piece_at(t, ((ramp, rising), (duration - ramp, steady)), falling)


@dataclass(frozen=True)
class MoveLimits:
    """Limits of a motion: speed in m/s, acceleration in m/s², jerk in m/s³ (``None``: acceleration may step)."""

    speed: float
    acceleration: float
    jerk: float | None


@dataclass(frozen=True)
class Move:
    """A motion from rest to rest: accelerate, cruise, and brake in reverse of the acceleration.

    With a jerk limit these are the seven segments of an S-curve: rising, constant and falling acceleration, cruise, and
    the same in reverse. A short distance has no cruise, a still shorter one no constant acceleration.

    Attributes:
        start, end: positions in m.
        begin: start time in s.
        ramp, cruise: durations in s of the acceleration from rest, and of the constant speed.
        speed: in m/s, negative for motion towards smaller x.
    """

    start: float
    end: float
    begin: float
    ramp: float
    cruise: float
    speed: float

    @property
    def finish(self) -> float:
        """Time in s of the end."""
        return self.begin + 2 * self.ramp + self.cruise

    def at(self, t: Scalar, jerk: float | None) -> Setpoint:
        """The motion at a time in s; at rest before it and after it."""
        way = math.copysign(1.0, self.speed)
        rising, braking = (
            speed_up(since, self.ramp, abs(self.speed), jerk) for since in (t - self.begin, self.finish - t)
        )
        gained = self.speed * self.ramp / 2
        pieces = (
            (self.begin, Setpoint(self.start, 0.0, 0.0)),
            (self.begin + self.ramp, Setpoint(self.start + way * rising.x, way * rising.v, way * rising.a)),
            (
                self.finish - self.ramp,
                Setpoint(self.start + gained + self.speed * (t - self.begin - self.ramp), self.speed, 0.0),
            ),
            (self.finish, Setpoint(self.end - way * braking.x, way * braking.v, -way * braking.a)),
        )
        return piece_at(t, pieces, Setpoint(self.end, 0.0, 0.0))


def gaining_time(speed: float, limits: MoveLimits) -> float:
    """Shortest time in s from rest to a speed in m/s."""
    if limits.jerk is None:
        return speed / limits.acceleration
    ramp = min(limits.acceleration / limits.jerk, math.sqrt(speed / limits.jerk))
    return ramp + speed / (limits.jerk * ramp)


def top_speed(distance: float, limits: MoveLimits) -> float:
    """Largest speed in m/s over a distance in m from rest to rest."""
    acceleration, jerk = limits.acceleration, limits.jerk
    if jerk is None:
        peak = math.sqrt(acceleration * distance)
    else:
        # acceleration and braking take half the distance each: distance = speed * gaining_time
        peak = (distance**2 * jerk / 4) ** (1 / 3)
        if peak > acceleration**2 / jerk:
            lost = acceleration**2 / jerk
            peak = 2 * acceleration * distance / (lost + math.sqrt(lost**2 + 4 * acceleration * distance))
    return min(limits.speed, peak)


@lru_cache(maxsize=64)
def moves(points: tuple[float, ...], pauses: tuple[float, ...], limits: MoveLimits) -> tuple[Move, ...]:
    """Moves from 0 m to each point in m in turn, with a pause in s at each; equal successive points make no move."""
    sequence, t = [], 0.0
    for (start, end), pause in zip(pairwise((0.0, *points)), pauses or (0.0,) * len(points), strict=True):
        if end != start:
            distance = abs(end - start)
            speed = top_speed(distance, limits)
            ramp = gaining_time(speed, limits)
            cruise = max(distance / speed - ramp, 0.0) if speed == limits.speed else 0.0  # else round-off
            sequence.append(Move(start, end, t, ramp, cruise, math.copysign(speed, end - start)))
            t = sequence[-1].finish
        t += pause
    return tuple(sequence)


def way_point_motion(t: Scalar, found: tuple[Move, ...], jerk: float | None) -> Setpoint:
    """Position, speed and acceleration at the time t in s, a float or an array."""
    times = np.atleast_1d(np.asarray(t, float))
    x, v, a = np.zeros_like(times), np.zeros_like(times), np.zeros_like(times)
    for move in found:
        started = times >= move.begin
        now = move.at(times[started], jerk)
        x[started], v[started], a[started] = now.x, now.v, now.a
    if np.ndim(t) == 0:
        return Setpoint(float(x[0]), float(v[0]), float(a[0]))
    return Setpoint(x, v, a)


def longest_cruise(found: tuple[Move, ...]) -> tuple[float, float] | None:
    """First and last time in s of the longest phase of constant speed; ``None`` without one."""
    cruises = [(move.cruise, move) for move in found if move.cruise > 0]
    if not cruises:
        return None
    longest = max(cruises, key=lambda pair: pair[0])[1]
    return longest.begin + longest.ramp, longest.finish - longest.ramp


Floats = NDArray[np.float64]

EQUAL = 1e-6
"""Tolerance of equal speeds as a share of the largest speed: numbers in files are rounded."""

MOVING = 1e-3
"""Share of the largest speed below which the vehicle counts as at rest."""

SLOWEST = 5e-3
"""Peak speed in m/s below which the unit of the times must be stated."""

LIKE, OTHER_SCALE = 0.8, 2.0
"""Least correlation of a recorded column with the derivative of another for a check of their ratio, and the bound of
the ratio and its inverse."""


class RecordedMotion:
    """A curve through recorded positions, with its speed and acceleration.

    From positions alone it is a cubic spline with continuous speed and acceleration. With recorded speeds it is the
    cubic Hermite curve through both, with steps of the acceleration at the rows. A recorded acceleration replaces that
    of the curve, interpolated linearly. Before the first row and after the last the vehicle rests at that row.
    """

    def __init__(self, t: Floats, x: Floats, v: Floats | None = None, a: Floats | None = None) -> None:
        """Interpolate at (n,) times in s: positions in m, speeds in m/s and accelerations in m/s²."""
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
        """First and last time in s of the longest phase of rows at constant speed; ``None`` without one."""
        speeds = np.diff(self.x) / np.diff(self.t)
        largest = np.abs(speeds).max()
        same = (np.abs(np.diff(speeds)) <= EQUAL * largest) & (np.abs(speeds[1:]) > MOVING * largest)
        ends = np.flatnonzero(np.diff(np.concatenate(([0], same.astype(int), [0]))))
        stretches = [(float(self.t[start]), float(self.t[last + 1])) for start, last in ends.reshape(-1, 2)]
        return max(stretches, key=lambda stretch: stretch[1] - stretch[0], default=None)


def _ratio(values: Floats, derivative: Floats) -> float | None:
    """Ratio of values to a derivative; None: they agree, or are no multiple of it."""
    size = float(np.sqrt((values @ values) * (derivative @ derivative)))
    if not size or abs(values @ derivative) < LIKE * size:
        return None
    ratio = float(values @ derivative) / float(derivative @ derivative)
    return None if 1 / OTHER_SCALE < ratio < OTHER_SCALE else ratio


def _check_recorded(recording: Recording, found: dict[str, Floats], named: dict[str, str]) -> None:
    """Raise `ConfigurationError` where times or derivatives must be in another unit."""
    file, time = recording.origin.file, recording.origin.time_column
    fastest = np.abs(np.diff(found["m"]) / np.diff(recording.t)).max()
    if 0 < fastest < SLOWEST and recording.time_unit is None:
        raise ConfigurationError(
            f'{file}: moves at {fastest:.3g} m/s at most, if {time} is in s: must be stated, time_unit = "s" or "ms"'
        )
    for si, of in (("m/s", "m"), ("m/s^2", "m/s")):
        ratio = _ratio(found[si], np.gradient(found[of], recording.t)) if si in found and of in found else None
        if ratio is not None:
            raise ConfigurationError(
                f"{file}: column '{named[si]}': is {ratio:.3g} times the derivative of '{named[of]}': must be in its "
                f"unit per s, or the header must state one, as in '{named[si]} [{si}]'"
            )


@lru_cache(maxsize=16)
def recorded_motion(
    recording: Recording, units: tuple[str | None, ...], derivatives: tuple[str, ...]
) -> RecordedMotion:
    """The motion of a recording whose columns have these units (``None``: as the file states), `derivatives` in SI.

    Raises:
        ConfigurationError: a unit is missing or of another quantity, or columns contradict each other.
    """
    columns = {
        si: recording.column(index, unit, si) for index, (unit, si) in enumerate(zip(units, derivatives, strict=True))
    }
    _check_recorded(recording, columns, dict(zip(derivatives, recording.names, strict=True)))
    return RecordedMotion(recording.t, columns["m"], columns.get("m/s"), columns.get("m/s^2"))
