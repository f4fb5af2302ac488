"""Motions to choose from: from rest to rest through way-points, at a speed and an acceleration within limits."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import Limits, gaining_time, top_speed
from dualwinch.model.reference import Reference, cruise_speed
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

TIME_OF_A_MOVE = 8.0
"""Time in s that a move of a motion has, on average."""

FEWEST, MOST = 2, 12
"""Moves of a motion."""

LEAST_WAY = 0.1
"""Way in m below which there is no move."""

HALVINGS = 40
"""Of the range in which the longest way is looked for."""

SLOWEST = 0.3
"""Least speed and acceleration, over the largest."""

JERK_TIME = 0.5
"""Time in s in which the acceleration rises to its largest, where the experiment has no jerk limit."""

SHARE_OF_FORCE = 0.5
"""Share of the ropes' largest net force that accelerates, unless something else is asked for; drag takes its own."""


@dataclass(frozen=True)
class Room:
    """Limits that a run keeps to.

    Attributes:
        farthest: position in m.
        speed: in m/s.
        acceleration: in m/s².
        jerk: in m/s³.
        tension: largest tension of a rope in N.
        torque: largest torque of a motor in N m; infinite: any.
    """

    farthest: float
    speed: float
    acceleration: float
    jerk: float
    tension: float
    torque: float = math.inf


def room_of(
    experiment: Experiment,
    *,
    track: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    torque: float | None = None,
) -> Room:
    """The limits of an experiment, some of them tightened.

    Args:
        experiment: gives track, cruise speed, jerk limit and tension limits.
        track: farthest position in m; default: a metre before the end.
        speed: largest in m/s; default: the reference's.
        acceleration: largest in m/s²; default: what half of the ropes' largest net force gives the vehicle.
        torque: largest of a motor in N m; default: any.

    Raises:
        ConfigurationError: a limit out of range.
    """
    length, limits = experiment.plant.track.length, experiment.controller.limits
    if track is not None and not 0 < track <= length:
        raise ConfigurationError(f"track = {track:g}: must be > 0 and <= plant.track.length = {length:g} m")
    given = {"speed": speed, "acceleration": acceleration, "torque": torque}
    for name, value in given.items():
        if value is not None and not 0 < value < math.inf:
            raise ConfigurationError(f"{name} = {value:g}: must be > 0")
    largest = acceleration or SHARE_OF_FORCE * float(limits.force) / experiment.plant.vehicle.mass
    jerk = experiment.reference.jerk_limit or largest / JERK_TIME
    top = speed or cruise_speed(experiment.reference)
    return Room(track or max(length - 1.0, length / 2), top, largest, jerk, limits.tension_max, torque or math.inf)


def moves_in(duration: float) -> int:
    """How many moves a motion of some duration in s is made of."""
    return int(np.clip(duration // TIME_OF_A_MOVE, FEWEST, MOST))


def dimensions(moves: int) -> int:
    """Numbers that describe a motion."""
    return 2 + 2 * moves


def motion(shares: Floats, room: Room, duration: float) -> Reference | None:
    """The motion that numbers between 0 and 1 stand for, in figures that a person reads; None: nothing moves.

    The duration is shared out among the moves. Each goes as far towards its target as there is time, and rests for what
    is left of it: so every motion is over in time, and changes little where the numbers do.

    Args:
        shares: (dimensions,) of speed and acceleration, then of every target and of the time that it gets.
        room: limits.
        duration: in s.
    """
    speed, acceleration = (
        min(_in_figures(SLOWEST ** (1 - share) * largest), largest)
        for share, largest in zip(shares[:2], (room.speed, room.acceleration), strict=True)
    )
    limits = Limits(speed, acceleration, _in_figures(room.jerk))
    targets, weights = shares[2::2] * room.farthest, shares[3::2] ** 2 + 1e-6
    points, pauses, position, late = list[float](), list[float](), 0.0, 0.0
    for target, time in zip(targets, np.diff(duration * np.cumsum(weights) / weights.sum(), prepend=0.0), strict=True):
        late += time
        way = _centimetres(min(abs(target - position), _farthest(late, limits)))
        if way < LEAST_WAY:
            continue
        position = round(position + float(np.copysign(way, target - position)), 2)
        points.append(position)
        pauses.append(max(_centimetres(late - _time(way, limits)) - 0.01, 0.0))
        late -= _time(way, limits) + pauses[-1]
    if not points:
        return None
    return Reference(
        kind="way-points",
        speed=speed,
        acceleration=acceleration,
        jerk_limit=limits.jerk,
        points=tuple(points),
        pauses=tuple(round(pause, 2) for pause in pauses),
    )


def _time(way: float, limits: Limits) -> float:
    """Time in s from rest to rest over a way in m."""
    speed = top_speed(way, limits)
    return gaining_time(speed, limits) + way / speed


def _farthest(time: float, limits: Limits) -> float:
    """The longest way in m that there is time in s for."""
    low, high = 0.0, max(limits.speed * time, LEAST_WAY)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _time(middle, limits) <= time else (low, middle)
    return low


def _centimetres(value: float) -> float:
    """A number in m or s, or a little less, with two decimals."""
    return float(np.floor(100 * value) / 100)


def _in_figures(value: float) -> float:
    """Two figures of a number."""
    return float(f"{value:.2g}")
