"""Overloads: events beyond the force of the ropes. A push, a payload that is taken up, a drive without torque.

Each begins at a time and is constant from sample to sample; a size of zero leaves it out. A motor's torque that falls
with its speed is a property of the actuator (`model.actuators`).
"""

from dataclasses import dataclass, replace
from typing import Annotated

from dualwinch.model.quantities.quantity import Mark, NonNegative, Quantity, UnitInterval
from dualwinch.model.scalar import Scalar, both
from dualwinch.model.vehicle import Vehicle

SIZES = (
    "disturbance.push.force",
    "disturbance.payload.mass",
    "disturbance.payload.drag",
    "disturbance.dropout_1.share",
    "disturbance.dropout_2.share",
    "actuator.motor.torque_limit",
    "actuator.motor.continuous_torque",
)
"""Keys of the sizes of overloads, which are absent at zero."""


@dataclass(frozen=True)
class Push:
    """A constant force on the vehicle for a while: a collision, a tether that catches, a gust of current."""

    force: Annotated[
        float, Quantity("N", "force on the vehicle along the track; 0: none", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    start: Annotated[
        NonNegative, Quantity("s", "time at which the push begins", "assumption"), Mark.SHAPE_PARAMETER
    ] = 20.0
    duration: Annotated[NonNegative, Quantity("s", "how long the push lasts", "assumption"), Mark.SHAPE_PARAMETER] = 0.3


@dataclass(frozen=True)
class Payload:
    """A payload that the vehicle takes up under way."""

    mass: Annotated[
        NonNegative, Quantity("1", "mass of the payload over the vehicle's; 0: none", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    drag: Annotated[
        NonNegative, Quantity("1", "drag of the payload over the vehicle's", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    start: Annotated[
        NonNegative, Quantity("s", "time at which the payload is taken up", "assumption"), Mark.SHAPE_PARAMETER
    ] = 20.0


@dataclass(frozen=True)
class Dropout:
    """A drive whose torque command is lost for a while: an undervoltage, a trip with restart."""

    share: Annotated[
        UnitInterval, Quantity("1", "share of the torque command that is lost; 0: none", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    start: Annotated[
        NonNegative, Quantity("s", "time at which the drive drops out", "assumption"), Mark.SHAPE_PARAMETER
    ] = 20.0
    duration: Annotated[
        NonNegative, Quantity("s", "how long the drive is out", "0.1, assumption"), Mark.SHAPE_PARAMETER
    ] = 0.1


def within(t: Scalar, start: Scalar, duration: Scalar) -> Scalar:
    """1 while a time in s is in an interval, its end excluded; else 0."""
    return both(t >= start, t < start + duration)


def push_force(t: Scalar, push: Push) -> Scalar:
    """Force in N of a push at a time in s.

    Example:
        >>> [push_force(t, Push(force=-8e3, start=20.0, duration=0.3)) for t in (19.9, 20.0, 20.3)]
        [-0.0, -8000.0, -0.0]
    """
    return push.force * within(t, push.start, push.duration)


def loaded_vehicle(t: Scalar, vehicle: Vehicle, payload: Payload) -> Vehicle:
    """The vehicle at a time in s, with the payload's mass and drag from its start on.

    Example:
        >>> loaded_vehicle(21.0, Vehicle(), Payload(mass=0.25)).mass
        12500.0
    """
    aboard = t >= payload.start
    return replace(
        vehicle,
        mass=vehicle.mass * (1 + payload.mass * aboard),
        drag_coefficient=vehicle.drag_coefficient * (1 + payload.drag * aboard),
    )


def remaining_torque(t: Scalar, torque: Scalar, dropout: Dropout) -> Scalar:
    """Torque command in N m that is left by a dropout at a time in s.

    Example:
        >>> remaining_torque(20.05, 30.0, Dropout(share=1.0))
        0.0
    """
    return torque * (1 - dropout.share * within(t, dropout.start, dropout.duration))
