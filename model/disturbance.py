"""Disturbances: vortex shedding, ambient current, changing load on the rail, a further force, and overloads.

Current and rail load may be random (Gauss–Markov), given as signals, or the sum of both.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

from dualwinch.model.overloads import Dropout, Payload, Push
from dualwinch.model.quantities.description import slots
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity
from dualwinch.model.scalar import Scalar, sin
from dualwinch.model.signals import Signal
from dualwinch.model.vehicle import Vehicle, drag


@dataclass(frozen=True)
class Disturbance:
    """Disturbances of a scenario; a standard deviation of zero switches a random disturbance off."""

    vortex: Annotated[bool, Quantity("", "vortex shedding on", "paper Section 4.3"), Mark.SWITCH, Mark.OFF_AT_ZERO] = (
        False
    )
    vortex_amplitude: Annotated[
        NonNegative, Quantity("1", "amplitude of the vortex force over the drag", "paper Section 4.3"), Mark.OFF_AT_ZERO
    ] = 0.2
    strouhal: Annotated[
        NonNegative, Quantity("1", "Strouhal number of the vortex frequency", "paper Section 4.3"), Mark.OFF_AT_ZERO
    ] = 0.2
    integrated_phase: Annotated[
        bool,
        Quantity("", "integrate the vortex frequency instead of multiplying it by the time", "E4"),
        Mark.SWITCH,
        Mark.OFF_AT_ZERO,
    ] = False
    current_sigma: Annotated[
        NonNegative,
        Quantity("m/s", "standard deviation of the ambient current; 0: none", "Assumption 1"),
        Mark.DRAWN_AHEAD,
    ] = 0.0
    current_time: Annotated[
        Positive, Quantity("s", "correlation time of the current", "assumption"), Mark.DRAWN_AHEAD, Mark.SHAPE_PARAMETER
    ] = 20.0
    current_limit: Annotated[
        NonNegative,
        Quantity("m/s", "largest ambient current, 0.3 knots", "Assumption 1"),
        Mark.DRAWN_AHEAD,
        Mark.SHAPE_PARAMETER,
    ] = 0.154
    normal_force_sigma: Annotated[
        NonNegative,
        Quantity("1", "standard deviation of the rail load over its mean; 0: none", "paper Section 2.3"),
        Mark.DRAWN_AHEAD,
    ] = 0.0
    normal_force_time: Annotated[
        Positive,
        Quantity("s", "correlation time of the rail load", "assumption"),
        Mark.DRAWN_AHEAD,
        Mark.SHAPE_PARAMETER,
    ] = 5.0
    push: Push = field(default_factory=Push)
    payload: Payload = field(default_factory=Payload)
    dropout_1: Dropout = field(default_factory=Dropout)
    dropout_2: Dropout = field(default_factory=Dropout)
    force: Annotated[Signal, Quantity("N", "force on the vehicle along the track")] = field(default_factory=Signal)
    current: Annotated[Signal, Quantity("m/s", "ambient current along the track")] = field(default_factory=Signal)
    normal_force_variation: Annotated[Signal, Quantity("N", "change of the force on the rail")] = field(
        default_factory=Signal
    )


def given_signals(disturbance: Disturbance) -> dict[str, tuple[Signal, str]]:
    """The given signals of a disturbance: name → signal and its SI unit."""
    fields = [slot for slot in slots(Disturbance, "") if slot.hint is Signal]
    return {slot.field: (getattr(disturbance, slot.field), slot.find(Quantity).unit) for slot in fields}


def vortex_frequency(v: Scalar, disturbance: Disturbance, vehicle: Vehicle) -> Scalar:
    """Angular shedding frequency in rad/s at the speed v in m/s, from the Strouhal number (paper Section 4.3)."""
    return 2 * math.pi * disturbance.strouhal * v / vehicle.diameter


def vortex_force(t: Scalar, v: Scalar, phase: Scalar, disturbance: Disturbance, vehicle: Vehicle) -> Scalar:
    """Vortex force D in N along the track, added to the vehicle's equation (paper Section 4.3, E4).

    The phase in rad is the integral of `vortex_frequency`, used where ``integrated_phase`` is set. Both switches of the
    disturbance may be numbers between 0 and 1.
    """
    paper_phase = vortex_frequency(v, disturbance, vehicle) * t
    angle = paper_phase + disturbance.integrated_phase * (phase - paper_phase)
    return disturbance.vortex * disturbance.vortex_amplitude * drag(v, vehicle) * sin(angle)
