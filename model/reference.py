"""Reference motions of the vehicle: the paper's (Section 4.1, E5), through way-points, or from a file.

With a jerk limit, every change of speed is an S-curve: it takes the same time and distance as without, but its
acceleration rises and falls linearly and is a little larger in between. Cruise, joints and end position stay exactly
the paper's. The speed step of `uniform` becomes the shortest S-curve from rest, with no phase of constant acceleration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import fspath
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import annotated_types as at
import numpy as np

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import (
    Departures,
    Move,
    MoveLimits,
    RecordedMotion,
    Setpoint,
    least_duration,
    longest_cruise,
    moves,
    piece_at,
    recorded_motion,
    speed_up,
    way_point_motion,
)
from dualwinch.model.quantities.quantity import NONE, Mark, Positive, Quantity, numbers_of
from dualwinch.model.recordings import Origin, Recording, recorded
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Reference:
    """The reference motion of the vehicle."""

    kind: Annotated[
        Literal["uniform", "profile", "way-points", "file"],
        Quantity("", "constant speed; accelerate, cruise and brake; rest to rest; recorded", "paper Section 4.1"),
        Mark.TIMING,
    ] = "profile"
    speed: Annotated[
        float | None,
        at.Gt(0),
        Quantity("m/s", "constant speed (uniform: 1.5, profile: 1.8, way-points: 1.8)", "paper Section 4.1"),
    ] = None
    accelerate_until: Annotated[Positive, Quantity("s", "profile: end of the acceleration", "paper Section 4.1")] = 18.0
    cruise_until: Annotated[Positive, Quantity("s", "profile: end of the constant speed", "paper Section 4.1")] = 29.0
    brake_until: Annotated[Positive, Quantity("s", "profile: end of the braking, then rest", "paper Section 4.1")] = (
        41.0
    )
    jerk_limit: Annotated[
        float | None,
        at.Gt(0),
        Quantity("m/s^3", "limit of the reference jerk (default: none, the acceleration steps)", "assumption"),
    ] = None
    acceleration: Annotated[Positive, Quantity("m/s^2", "way-points: largest acceleration", "paper Section 4.1")] = 0.1
    points: Annotated[tuple[float, ...], at.Ge(0), Quantity("m", "way-points: positions to reach in turn, from 0")] = (
        NONE
    )
    pauses: Annotated[tuple[float, ...], at.Ge(0), Quantity("s", "way-points: pause at each point (default: none)")] = (
        NONE
    )
    file: Annotated[str | None, Quantity("", "file: CSV or Parquet file that holds the motion"), Mark.FILE] = None
    column: Annotated[
        str | None, Quantity("", "file: column of the position (default: the only one beside those named)")
    ] = None
    unit: Annotated[str | None, Quantity("", "file: unit of the position, such as mm (default: as the file says)")] = (
        None
    )
    speed_column: Annotated[str | None, Quantity("", "file: column of the speed (default: the curve's own)")] = None
    acceleration_column: Annotated[
        str | None, Quantity("", "file: column of the acceleration (default: the curve's own)")
    ] = None
    time_column: Annotated[str, Quantity("", "file: column of the times")] = "t"
    time_unit: Annotated[str | None, Quantity("", "file: unit of the times (default: as the file says, else s)")] = None
    digest: Annotated[
        str | None, Quantity("", "file: digest of the numbers read; others are an error"), Mark.DIGEST
    ] = None
    field_marks: ClassVar = frozenset({Mark.DRAWN_AHEAD})

    recording: Annotated[Recording | None, Mark.CONTENT] = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Read the file of a recorded motion.

        Raises:
            ConfigurationError: it cannot be read.
        """
        keep = object.__setattr__
        keep(self, "points", numbers_of(self.points))
        keep(self, "pauses", numbers_of(self.pauses))
        if self.file is not None:
            keep(self, "file", str(Path(fspath(self.file)).absolute()))
        if self.kind != "file" or self.file is None:
            keep(self, "recording", None)
            return
        rate_columns = tuple(name for name in (self.speed_column, self.acceleration_column) if name is not None)
        origin = Origin(self.file, self.time_column, self.time_unit, (self.column, *rate_columns))
        recording = recorded(origin, self.recording, self.digest)
        keep(self, "recording", recording)
        keep(self, "digest", recording.digest)

    @property
    def start(self) -> float:
        """Position in m at t = 0, where a run begins at rest."""
        return float(setpoint(0.0, self).x)

    @property
    def moves(self) -> tuple[Move, ...]:
        """The moves through the way-points."""
        limits = MoveLimits(cruise_speed(self), self.acceleration, self.jerk_limit)
        return moves(self.points, self.pauses, limits)

    @property
    def recorded(self) -> RecordedMotion:
        """The motion of the file.

        Raises:
            ConfigurationError: there is none, or a unit is missing or of another quantity.
        """
        if self.recording is None:
            raise ConfigurationError('reference.file: must be given where reference.kind = "file"')
        columns = [("m", self.unit)]
        for name, si, unit in (("speed_column", "m/s", "/s"), ("acceleration_column", "m/s^2", "/s^2")):
            if getattr(self, name) is not None:
                columns.append((si, None if self.unit is None else self.unit + unit))
        quantities, units = zip(*columns, strict=True)
        return recorded_motion(self.recording, units, quantities)


KEYS_OF_KIND: dict[str, tuple[str, ...]] = {
    "profile": ("accelerate_until", "cruise_until", "brake_until"),
    "way-points": ("points", "pauses"),
    "file": ("file", "column", "unit", "speed_column", "acceleration_column", "time_column", "time_unit", "digest"),
}
"""Kind → keys without effect on a motion of another kind."""

PAPER_SPEED = {"uniform": 1.5, "profile": 1.8, "way-points": 1.8, "file": 1.8}
PAPER_DURATION = {"uniform": 25.0, "profile": 50.0}


def own_duration(reference: Reference) -> float:
    """Default duration in s of a run: the paper's, else until the end of the motion."""
    if reference.kind == "way-points" and reference.points:
        ended = reference.moves[-1].finish if reference.moves else 0.0
        return ended + (reference.pauses[-1] if reference.pauses else 0.0)
    if reference.recording is not None:
        return float(reference.recording.t[-1])
    return PAPER_DURATION.get(reference.kind, 50.0)


def cruise_speed(reference: Reference) -> float:
    """The constant speed in m/s: the given one, else the paper's."""
    return PAPER_SPEED[reference.kind] if reference.speed is None else reference.speed


def steady_window(reference: Reference, duration: float) -> tuple[float, float]:
    """First and last time in s of the steady state: the constant-speed phase (A13).

    For `uniform` the last fifth of the run, 20 to 25 s in the paper's cases; for way-points and files the longest phase
    of constant speed, or the whole run without one.
    """
    if reference.kind in {"way-points", "file"}:
        cruise = (
            longest_cruise(reference.moves) if reference.kind == "way-points" else reference.recorded.longest_cruise
        )
        start, end = cruise or (0.0, duration)
        return (start, min(end, duration)) if start < duration else (0.0, duration)
    if reference.kind == "uniform":
        return 0.8 * duration, duration
    return reference.accelerate_until, reference.cruise_until


def setpoint(t: Scalar, reference: Reference) -> Setpoint:
    """Reference position, speed and acceleration at the time t in s; at a joint, those of the piece before it."""
    speed, jerk_limit = cruise_speed(reference), reference.jerk_limit
    if reference.kind == "file":
        return reference.recorded.at(t)
    if reference.kind == "way-points":
        return way_point_motion(t, reference.moves, jerk_limit)
    if reference.kind == "uniform":
        cruise = Setpoint(speed * t, speed + 0.0 * t, 0.0 * t)
        if jerk_limit is None:
            return cruise
        start = least_duration(speed, jerk_limit)
        cruise_from_start = Setpoint(cruise.x - speed * start / 2, cruise.v, cruise.a)
        return piece_at(t, ((start, speed_up(t, start, speed, jerk_limit)),), cruise_from_start)
    t_1, t_2, t_3 = reference.accelerate_until, reference.cruise_until, reference.brake_until
    x_1 = speed * t_1 / 2
    x_2 = x_1 + speed * (t_2 - t_1)
    x_3 = x_2 + speed * (t_3 - t_2) / 2
    braking = speed_up(t_3 - t, t_3 - t_2, speed, jerk_limit)
    pieces = (
        (t_1, speed_up(t, t_1, speed, jerk_limit)),
        (t_2, Setpoint(x_1 + speed * (t - t_1), speed, 0.0)),
        (t_3, Setpoint(x_3 - braking.x, braking.v, -braking.a)),
    )
    return piece_at(t, pieces, Setpoint(x_3, 0.0, 0.0))


INSTANTS = 1000
"""Instants at which the speed of a motion is evaluated."""


def largest_speed(reference: Reference, duration: float) -> float:
    """Largest speed in m/s from the beginning to a `duration` in s."""
    return float(np.abs(setpoint(np.linspace(0.0, duration, INSTANTS), reference).v).max())


def departures(t: Scalar, times: Sequence[float], reference: Reference) -> Departures:
    """Deviations of the future reference, at some `times` in s ahead of t, from constant acceleration since t.

    Each is a list with elements of the type of t. Beyond the end of a run the motion continues: at rest where it has
    ended, else at its speed.
    """
    now, deviations = setpoint(t, reference), []
    for by in times:
        then, expected = setpoint(t + by, reference), now.ahead(by)
        deviations.append((then.x - expected.x, then.v - expected.v, then.a - expected.a))
    x, v, a = zip(*deviations, strict=True) if deviations else ((), (), ())
    return Departures(list(x), list(v), list(a))
