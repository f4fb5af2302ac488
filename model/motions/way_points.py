"""From rest to rest through way-points, in the least time that limits of speed, acceleration and jerk allow."""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from dualwinch.model.motions.s_curve import speed_up
from dualwinch.model.motions.setpoint import Setpoint, piece_at
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Limits:
    """What a motion keeps to: speed in m/s, acceleration in m/s², jerk in m/s³ (``None``: acceleration may step)."""

    speed: float
    acceleration: float
    jerk: float | None


@dataclass(frozen=True)
class Move:
    """A motion from rest to rest: speed up, cruise, and brake as the speed was gained.

    With a jerk limit these are the seven segments of an S-curve: acceleration rises, holds and falls, none, and the
    same backwards. Where the way is short there is no cruise; where it is shorter still, no constant acceleration
    either.

    Attributes:
        start, end: in m.
        begin: time in s.
        ramp, cruise: time in s from rest to the speed, and at it.
        speed: in m/s, negative on the way back.
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


def gaining_time(speed: float, limits: Limits) -> float:
    """Shortest time in s from rest to a speed in m/s."""
    if limits.jerk is None:
        return speed / limits.acceleration
    ramp = min(limits.acceleration / limits.jerk, math.sqrt(speed / limits.jerk))
    return ramp + speed / (limits.jerk * ramp)


def top_speed(distance: float, limits: Limits) -> float:
    """Largest speed in m/s on a way of a distance in m from rest to rest."""
    acceleration, jerk = limits.acceleration, limits.jerk
    if jerk is None:
        peak = math.sqrt(acceleration * distance)
    else:
        # speed times gaining time is the distance, for speeding up and braking take half of it each
        peak = (distance**2 * jerk / 4) ** (1 / 3)
        if peak > acceleration**2 / jerk:
            lost = acceleration**2 / jerk
            peak = 2 * acceleration * distance / (lost + math.sqrt(lost**2 + 4 * acceleration * distance))
    return min(limits.speed, peak)


@lru_cache(maxsize=64)
def moves(points: tuple[float, ...], pauses: tuple[float, ...], limits: Limits) -> tuple[Move, ...]:
    """The moves from 0 m to each of some points in turn.

    Args:
        points: positions in m; the same one twice is no move.
        pauses: time in s at rest at each point; empty: none.
        limits: of all moves.
    """
    found, t = [], 0.0
    for (start, end), pause in zip(pairwise((0.0, *points)), pauses or (0.0,) * len(points), strict=True):
        if end != start:
            distance = abs(end - start)
            speed = top_speed(distance, limits)
            ramp = gaining_time(speed, limits)
            cruise = max(distance / speed - ramp, 0.0) if speed == limits.speed else 0.0  # else round-off
            found.append(Move(start, end, t, ramp, cruise, math.copysign(speed, end - start)))
            t = found[-1].finish
        t += pause
    return tuple(found)


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
    """First and last time in s of the longest stretch of constant speed; ``None`` where there is none."""
    cruises = [(move.cruise, move) for move in found if move.cruise > 0]
    if not cruises:
        return None
    longest = max(cruises, key=lambda pair: pair[0])[1]
    return longest.begin + longest.ramp, longest.finish - longest.ramp
