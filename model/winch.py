"""Winch: motor, gearbox and drum; positive in the direction that retrieves rope (paper Section 2.4, E1).

A drum may be eccentric and wound in several layers. A turn by dtheta retrieves ``radius(theta) dtheta``, with::

    radius(theta) = drum_radius (1 + radius_error)
                    + layer_thickness/layer_laps theta/(2 π)                     the rope's layers
                    + eccentricity cos(theta + eccentricity_angle)               the drum's run-out

The layers grow linearly, as on a spiral; the data sheet gives the radius at the angle 0, where every run begins.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import annotated_types as at

from dualwinch.model.quantities.part import NoState
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Rule, UnitInterval
from dualwinch.model.scalar import Scalar, absolute, clip, cos, either, exp, present, sin, tanh, where


@dataclass(frozen=True)
class Winch:
    """One winch; the fields marked as unknown are its deviations from the data sheet."""

    inertia: Annotated[Positive, Quantity("kg m^2", "inertia at the drum", "Table 1")] = 1.8
    drum_radius: Annotated[Positive, Quantity("m", "radius of the drum", "Table 1")] = 0.8
    gear_ratio: Annotated[Positive, Quantity("1", "motor turns per drum turn", "Table 1")] = 36.0
    rotor_inertia: Annotated[
        NonNegative,
        Quantity("kg m^2", "inertia of the motor's rotor at its own shaft, in addition to inertia", "0.02, A14"),
        Mark.OFF_AT_ZERO,
    ] = 0.0
    gear_stiffness: Annotated[
        NonNegative,
        Quantity("N m/rad", "stiffness of the gearbox at the drum; 0: rigid", "1.4e6, A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    gear_damping: Annotated[
        NonNegative, Quantity("N m s/rad", "damping of the gearbox at the drum", "A14"), Mark.OFF_AT_ZERO
    ] = 0.0
    backlash: Annotated[
        NonNegative, at.Le(0.1), Quantity("rad", "backlash of the gearbox at the drum", "A14"), Mark.OFF_AT_ZERO
    ] = 0.0
    transmission_error: Annotated[
        NonNegative,
        at.Le(0.1),
        Quantity("rad", "amplitude of the gearbox's transmission error at the drum", "A14"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    transmission_waves: Annotated[
        NonNegative,
        Quantity("1", "periods of the transmission error per drum turn", "A14"),
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 6.0
    gear_loss: Annotated[
        NonNegative,
        at.Lt(1),
        Quantity("1", "friction of the gearbox as a share of the rope's torque", "A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    sheave_friction: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("1", "friction of the rope on its sheaves, mu theta, between drum and vehicle", "0.04, A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    cell_beyond: Annotated[
        UnitInterval,
        Quantity("1", "share of that friction between drum and load cell; 0: it is at the drum, 1: beyond", "A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    coulomb_friction: Annotated[
        NonNegative, Quantity("N m", "Coulomb friction at the drum", "A5"), Mark.OFF_AT_ZERO
    ] = 0.0
    viscous_friction: Annotated[
        NonNegative, Quantity("N m s", "viscous friction at the drum", "A5"), Mark.OFF_AT_ZERO
    ] = 0.0
    layer_thickness: Annotated[
        NonNegative,
        at.Le(0.5),
        Quantity("m", "growth of the radius per full layer of rope; 0: one layer", "assumption"),
        Mark.OFF_AT_ZERO,
    ] = 0.0
    layer_laps: Annotated[
        float, at.Ge(1), Quantity("1", "drum turns that fill a layer", "assumption"), Mark.SHAPE_PARAMETER
    ] = 20.0
    radius_error: Annotated[
        float,
        at.Ge(-0.5),
        at.Le(0.5),
        Quantity("1", "share by which the radius is larger than drum_radius", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    eccentricity: Annotated[
        NonNegative,
        at.Le(0.1),
        Quantity("m", "distance of the drum's centre from its axis", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    eccentricity_angle: Annotated[
        float,
        Quantity("rad", "angle of the drum's largest radius at drum angle 0", "assumption"),
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 0.0
    torque_error: Annotated[
        float,
        at.Gt(-1),
        at.Le(1),
        Quantity("1", "share by which the motor gives more torque than its command", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    torque_ripple: Annotated[
        UnitInterval,
        Quantity("1", "amplitude of the torque ripple as a share of the torque", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    ripple_waves: Annotated[
        NonNegative,
        Quantity("1", "periods of the ripple per motor turn", "assumption"),
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 6.0
    ripple_angle: Annotated[
        float, Quantity("rad", "phase of the ripple at drum angle 0", "assumption"), Mark.UNKNOWN, Mark.SHAPE_PARAMETER
    ] = 0.0

    rules: ClassVar = (
        Rule(
            ("eccentricity", "drum_radius"),
            lambda winch: winch.eccentricity <= winch.drum_radius / 4,
            lambda winch, _: f"must be <= {winch.drum_radius / 4:g} m (a quarter of drum_radius)",
        ),
        Rule(
            ("gear_stiffness", "rotor_inertia"),
            lambda winch: either(winch.gear_stiffness == 0, winch.rotor_inertia > 0),
            lambda _, table: (
                f"must be 0 (rigid) without {table}rotor_inertia > 0: a compliant gearbox is between two inertias"
            ),
        ),
    )


FRICTION_SPEED = 0.01
"""Drum speed in rad/s over which the Coulomb friction changes its sign (A5)."""


def friction_torque(omega: Scalar, winch: Winch) -> Scalar:
    """Friction torque tau_f in N m at the drum speed omega in rad/s (A5)."""
    return winch.coulomb_friction * tanh(omega / FRICTION_SPEED) + winch.viscous_friction * omega


def friction_slope(omega: Scalar, winch: Winch) -> Scalar:
    """Slope of `friction_torque` over the drum speed in N m s."""
    steepness = 1 - tanh(omega / FRICTION_SPEED) ** 2
    return winch.coulomb_friction / FRICTION_SPEED * steepness + winch.viscous_friction


def drum_acceleration(
    omega: Scalar, tension: Scalar, torque: Scalar, winch: Winch, radius: Scalar | None = None, rope: Scalar = 0.0
) -> Scalar:
    """Acceleration of the drum in rad/s² (paper Section 2.4, E3), at its speed omega in rad/s.

    From the rope's tension in N and the motor torque in N m before the gearbox. The rope leaves the drum on a radius in
    m, by default ``drum_radius``, and adds an inertia in kg m².
    """
    lever = winch.drum_radius if radius is None else radius
    drive = winch.gear_ratio * torque - lever * tension - friction_torque(omega, winch)
    return drive / (total_inertia(winch) + rope)


@dataclass(frozen=True)
class Rotor:
    """State of the motor's rotor behind a compliant gearbox, referred to the drum's shaft."""

    theta: Annotated[Scalar, Quantity("rad", "angle of the motor over the gear ratio")]
    omega: Annotated[Scalar, Quantity("rad/s", "speed of the motor over the gear ratio"), Mark.RATE]


def total_inertia(winch: Winch) -> Scalar:
    """Inertia in kg m² of drum and rotor at the drum, with a rigid gearbox."""
    return winch.inertia + winch.gear_ratio**2 * winch.rotor_inertia


def steady_motor(load: Scalar, theta: Scalar, omega: Scalar, winch: Winch) -> Any:
    """State of the rotor while its gearbox transmits a constant load in N m, at a drum angle in rad and speed in rad/s.

    The sign of the load decides which tooth flanks are in contact.
    """
    if not present(winch.gear_stiffness):
        return NoState()
    half = winch.backlash / 2
    twist = load / winch.gear_stiffness + where(load >= 0, half, -half)
    return Rotor(theta + twist + transmission(theta, winch), omega)


def over_sheaves(tension: Scalar, omega: Scalar, winch: Winch, beyond: Scalar = 0.0) -> Scalar:
    """Rope tension in N on the drum's side of its sheaves at a drum speed in rad/s, or after a share `beyond` of them.

    By the capstan equation the side towards which the rope slides has e^(mu theta) times the tension of the other
    (Euler 1769; Eytelwein, *Handbuch der Statik fester Körper*, 1808); about rest the exponent changes its sign as
    Coulomb friction does (A5).
    """
    if not present(winch.sheave_friction):
        return tension
    return tension * exp((1 - beyond) * winch.sheave_friction * tanh(omega / FRICTION_SPEED))


def cell_tension(tension: Scalar, omega: Scalar, winch: Winch) -> Scalar:
    """Tension in N at the load cell, for that of the rope beyond its sheaves, at the drum speed in rad/s."""
    return over_sheaves(tension, omega, winch, winch.cell_beyond)


def tension_beyond_sheaves(cell: Scalar, omega: Scalar, winch: Winch) -> Scalar:
    """Tension of the rope in N beyond its sheaves, for that at the load cell; inverse of `cell_tension`."""
    return over_sheaves(cell, -omega, winch, winch.cell_beyond)


def with_gear_loss(tension: Scalar, omega: Scalar, winch: Winch) -> Scalar:
    """Rope tension in N plus the gearbox's load-dependent friction, as a tension, at the drum speed in rad/s."""
    if not present(winch.gear_loss):
        return tension
    return tension + winch.gear_loss * absolute(tension) * tanh(omega / FRICTION_SPEED)


def transmission(theta: Scalar, winch: Winch) -> Scalar:
    """Transmission error of the gearbox in rad at the drum angle theta in rad."""
    return winch.transmission_error * sin(winch.transmission_waves * theta)


def gear_torque(theta: Scalar, omega: Scalar, rotor: Rotor, winch: Winch) -> Scalar:
    """Torque in N m that the gearbox transmits to the drum: a spring and a damper with backlash.

    It is zero within the backlash, where the teeth are not in contact.
    """
    twist, half = rotor.theta - theta - transmission(theta, winch), winch.backlash / 2
    pressed = twist - clip(twist, -half, half)
    torque = winch.gear_stiffness * pressed + winch.gear_damping * (rotor.omega - omega)
    return where(pressed * torque > 0, torque, 0.0)  # teeth push, never pull


def winch_rates(
    theta: Scalar, omega: Scalar, motor: Any, tension: Scalar, torque: Scalar, winch: Winch, rope: Scalar
) -> tuple[Scalar, Any]:
    """Acceleration of the drum in rad/s², and the rates of the rotor's state, `NoState` where the gearbox is rigid.

    At a drum angle in rad and speed in rad/s, from the tension of the rope at the drum in N and the motor torque in N m
    before the gearbox. A mass of `rope` in kg turns with the drum.
    """
    radius = winding(theta, winch).radius
    turning = rope * radius**2
    tension = with_gear_loss(over_sheaves(tension, omega, winch), omega, winch)
    if not isinstance(motor, Rotor):
        return drum_acceleration(omega, tension, torque, winch, radius, turning), motor
    passed = gear_torque(theta, omega, motor, winch)
    alpha = (passed - radius * tension - friction_torque(omega, winch)) / (winch.inertia + turning)
    rotor = (winch.gear_ratio * torque - passed) / (winch.gear_ratio**2 * winch.rotor_inertia)
    return alpha, Rotor(motor.omega, rotor)


def shaft_torque(torque: Scalar, theta: Scalar, winch: Winch) -> Scalar:
    """Motor torque in N m for the command `torque`, with torque error and ripple, at the drum angle theta in rad."""
    wave = sin(winch.ripple_waves * winch.gear_ratio * theta + winch.ripple_angle)
    return torque * (1 + winch.torque_error + winch.torque_ripple * wave)


def specified_winch(winch: Winch) -> Winch:
    """The winch of the data sheet, without its unknown errors."""
    return replace(
        winch, radius_error=0.0, eccentricity=0.0, torque_error=0.0, torque_ripple=0.0, transmission_error=0.0
    )


TURN = 2 * math.pi
"""A turn in rad."""


@dataclass(frozen=True)
class Winding:
    """Wound rope and radius about one drum angle, as a third-order Taylor series in the turn from there.

    The truncation error for an eccentric drum is eccentricity turn⁴/24: 1e-17 m in a sample of 1 ms at 1 m/s.

    Attributes:
        base: constant part of the radius in m.
        theta: the angle in rad.
        beyond: wound rope in m beyond ``base theta``.
        excess: radius in m beyond `base`.
        growth, bend: first and second derivative of the radius with respect to the angle, in m.
    """

    base: Scalar
    theta: Scalar
    beyond: Scalar
    excess: Scalar
    growth: Scalar
    bend: Scalar

    @property
    def rope(self) -> Scalar:
        """Rope in m wound since the angle 0."""
        return self.base * self.theta + self.beyond

    @property
    def radius(self) -> Scalar:
        """Radius in m."""
        return self.base + self.excess

    def radius_after(self, turn: Scalar) -> Scalar:
        """Radius in m a turn in rad from here."""
        return self.base + (self.excess + turn * (self.growth + turn / 2 * self.bend))

    def beyond_of(self, rope: Scalar) -> Scalar:
        """Wound rope in m beyond ``base theta`` at the nearby angle theta at which `rope` m are wound."""
        radius = self.radius
        straight = (rope - self.rope) / radius
        turn = straight - straight**2 * (self.growth / 2 + straight * self.bend / 6) / radius
        return self.beyond + turn * (self.excess + turn * (self.growth / 2 + turn * self.bend / 6))


def winding(theta: Scalar, winch: Winch) -> Winding:
    """Rope on a winch's drum around the angle theta in rad."""
    layer = winch.layer_thickness / (TURN * winch.layer_laps)
    angle = theta + winch.eccentricity_angle
    sine_offset, cosine_offset = winch.eccentricity * sin(angle), winch.eccentricity * cos(angle)
    return Winding(
        base=base_radius(winch),
        theta=theta,
        beyond=layer / 2 * theta**2 + (sine_offset - winch.eccentricity * sin(winch.eccentricity_angle)),
        excess=layer * theta + cosine_offset,
        growth=layer - sine_offset,
        bend=-cosine_offset,
    )


NEWTON = 4
"""Newton steps from the angle of a round drum; each leaves about the third power of the previous error."""


def angle_of(rope: Scalar, winch: Winch) -> Scalar:
    """Angle in rad at which `rope` m are wound since the angle 0, by Newton's method."""
    theta = rope / base_radius(winch)
    for _ in range(NEWTON):
        theta = (rope - winding(theta, winch).beyond_of(rope)) / base_radius(winch)
    return theta


def base_radius(winch: Winch) -> Scalar:
    """Constant part of a drum's radius in m."""
    return winch.drum_radius * (1 + winch.radius_error)
