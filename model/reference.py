"""Reference motions of the vehicle (paper Section 4.1, E5)."""

from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at

from model.quantity import Quantity
from model.scalar import Scalar, where


@dataclass(frozen=True)
class Reference:
    """Which motion the vehicle is asked to make."""

    kind: Annotated[
        Literal["uniform", "profile"],
        Quantity("", "constant speed from the start, or speed up, cruise and brake", "paper Section 4.1"),
    ] = "profile"
    speed: Annotated[
        float | None,
        at.Gt(0),
        Quantity("m/s", "constant speed (uniform: 1.5, profile: 1.8)", "paper Section 4.1"),
    ] = None
    accelerate_until: Annotated[
        float, at.Gt(0), Quantity("s", "profile: end of the acceleration", "paper Section 4.1")
    ] = 18.0
    cruise_until: Annotated[
        float, at.Gt(0), Quantity("s", "profile: end of the constant speed", "paper Section 4.1")
    ] = 29.0
    brake_until: Annotated[
        float, at.Gt(0), Quantity("s", "profile: end of the braking, then rest", "paper Section 4.1")
    ] = 41.0


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
    speed = cruise_speed(reference)
    if reference.kind == "uniform":
        return Setpoint(speed * t, speed + 0.0 * t, 0.0 * t)
    t_1, t_2, t_3 = reference.accelerate_until, reference.cruise_until, reference.brake_until
    speeding_up, braking = speed / t_1, speed / (t_3 - t_2)
    x_1 = speed * t_1 / 2
    x_2 = x_1 + speed * (t_2 - t_1)
    x_3 = x_2 + speed * (t_3 - t_2) / 2
    left = t_3 - t
    pieces = (
        (t_1, Setpoint(speeding_up * t**2 / 2, speeding_up * t, speeding_up)),
        (t_2, Setpoint(x_1 + speed * (t - t_1), speed, 0.0)),
        (t_3, Setpoint(x_3 - braking * left**2 / 2, braking * left, -braking)),
    )
    at_rest = Setpoint(x_3, 0.0, 0.0)
    found = at_rest
    for end, piece in reversed(pieces):
        found = Setpoint(
            x=where(t <= end, piece.x, found.x),
            v=where(t <= end, piece.v, found.v),
            a=where(t <= end, piece.a, found.a),
        )
    return found
