"""Reference motions of the vehicle (paper Section 4.1, E5), as the paper has them or with bounded jerk.

With a jerk limit, every change of speed takes as long and as far as the paper's, but its acceleration rises and falls
along straight ramps and is a little larger between them: an S-curve. Cruise, joints and end position stay exactly the
paper's. The step of `uniform` becomes the shortest S-curve from rest to its speed, with no phase of constant
acceleration.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at

from dualwinch.model.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, maximum, sqrt, where


@dataclass(frozen=True)
class Reference:
    """Which motion the vehicle is asked to make."""

    kind: Annotated[
        Literal["uniform", "profile"],
        Quantity("", "constant speed from the start, or speed up, cruise and brake", "paper Section 4.1"),
        Mark.TIMING,
    ] = "profile"
    speed: Annotated[
        float | None,
        at.Gt(0),
        Quantity("m/s", "constant speed (uniform: 1.5, profile: 1.8)", "paper Section 4.1"),
        Mark.DRAWN_AHEAD,
    ] = None
    accelerate_until: Annotated[
        float, at.Gt(0), Quantity("s", "profile: end of the acceleration", "paper Section 4.1"), Mark.DRAWN_AHEAD
    ] = 18.0
    cruise_until: Annotated[
        float, at.Gt(0), Quantity("s", "profile: end of the constant speed", "paper Section 4.1"), Mark.DRAWN_AHEAD
    ] = 29.0
    brake_until: Annotated[
        float, at.Gt(0), Quantity("s", "profile: end of the braking, then rest", "paper Section 4.1"), Mark.DRAWN_AHEAD
    ] = 41.0
    jerk_limit: Annotated[
        float | None,
        at.Gt(0),
        Quantity("m/s^3", "bound on the rate of the reference acceleration (default: none, it steps)", "assumption"),
        Mark.DRAWN_AHEAD,
    ] = None


@dataclass(frozen=True)
class Setpoint:
    """Where the vehicle should be."""

    x: Annotated[Scalar, Quantity("m", "reference position")]
    v: Annotated[Scalar, Quantity("m/s", "reference speed")]
    a: Annotated[Scalar, Quantity("m/s^2", "reference acceleration")]


PAPER_SPEED = {"uniform": 1.5, "profile": 1.8}
PAPER_DURATION = {"uniform": 25.0, "profile": 50.0}


def cruise_speed(reference: Reference) -> float:
    """The constant speed in m/s: the given one, else the paper's."""
    return PAPER_SPEED[reference.kind] if reference.speed is None else reference.speed


def steady_window(reference: Reference, duration: float) -> tuple[float, float]:
    """First and last time in s of the steady state: the constant-speed phase (A13).

    For `uniform` that is the last fifth of the run, 20 to 25 s in the paper's cases.
    """
    if reference.kind == "uniform":
        return 0.8 * duration, duration
    return reference.accelerate_until, reference.cruise_until


def setpoint(t: Scalar, reference: Reference) -> Setpoint:
    """Reference position, speed and acceleration at the time t in s; at a joint, of the piece before it."""
    speed, jerk_limit = cruise_speed(reference), reference.jerk_limit
    if reference.kind == "uniform":
        cruise = Setpoint(speed * t, speed + 0.0 * t, 0.0 * t)
        if jerk_limit is None:
            return cruise
        start = least_duration(speed, jerk_limit)
        late = Setpoint(cruise.x - speed * start / 2, cruise.v, cruise.a)
        return _piece_at(t, ((start, speed_up(t, start, speed, jerk_limit)),), late)
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
    return _piece_at(t, pieces, Setpoint(x_3, 0.0, 0.0))


def least_duration(speed: Scalar, jerk_limit: Scalar) -> Scalar:
    """Shortest time in s from rest to a speed in m/s with a jerk limit in m/s³."""
    return 2 * sqrt(speed / jerk_limit)


def speed_up(t: Scalar, duration: Scalar, speed: Scalar, jerk_limit: Scalar | None) -> Setpoint:
    """Motion from rest at t = 0 to a speed in a given time, over ``speed * duration / 2`` whatever the jerk limit.

    Args:
        t: time in s, 0 to `duration`.
        duration: in s, at least `least_duration` where there is a jerk limit.
        speed: at the end, in m/s.
        jerk_limit: slope in m/s³ of the acceleration's two ramps; ``None``: constant acceleration.
    """
    if jerk_limit is None:
        acceleration = speed / duration
        return Setpoint(acceleration * t**2 / 2, acceleration * t, acceleration)
    # ramp * (duration - ramp) * jerk_limit = speed; the root is written without a difference of nearly equal numbers
    spare = maximum(duration**2 - 4 * speed / jerk_limit, 0.0)
    ramp = 2 * speed / jerk_limit / (duration + sqrt(spare))
    acceleration, after, left = jerk_limit * ramp, t - ramp, duration - t
    rising = Setpoint(jerk_limit * t**3 / 6, jerk_limit * t**2 / 2, jerk_limit * t)
    gained = jerk_limit * ramp**2 / 2
    steady = Setpoint(
        gained * ramp / 3 + gained * after + acceleration * after**2 / 2, gained + acceleration * after, acceleration
    )
    falling = Setpoint(
        speed * duration / 2 - speed * left + jerk_limit * left**3 / 6,
        speed - jerk_limit * left**2 / 2,
        jerk_limit * left,
    )
    return _piece_at(t, ((ramp, rising), (duration - ramp, steady)), falling)


def _piece_at(t: Scalar, pieces: tuple[tuple[Scalar, Setpoint], ...], last: Setpoint) -> Setpoint:
    """The piece whose end is the first not before t, or the last one, which has no end."""
    found = last
    for end, piece in reversed(pieces):
        found = Setpoint(
            x=where(t <= end, piece.x, found.x),
            v=where(t <= end, piece.v, found.v),
            a=where(t <= end, piece.a, found.a),
        )
    return found
