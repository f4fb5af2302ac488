"""Winch: motor, gearbox and drum; positive in the direction that retrieves rope (paper Section 2.4, E1)."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.model.quantities.quantity import Mark, Quantity, Rule
from dualwinch.model.scalar import Scalar, sin, tanh


@dataclass(frozen=True)
class Winch:
    """One winch; what is marked as unknown is what makes a real one differ from its data sheet."""

    inertia: Annotated[float, at.Gt(0), Quantity("kg m^2", "inertia at the drum", "Table 1")] = 1.8
    drum_radius: Annotated[float, at.Gt(0), Quantity("m", "radius of the drum", "Table 1")] = 0.8
    gear_ratio: Annotated[float, at.Gt(0), Quantity("1", "motor turns a drum turn", "Table 1")] = 36.0
    coulomb_friction: Annotated[
        float, at.Ge(0), Quantity("N m", "Coulomb friction at the drum", "A5"), Mark.OFF_AT_ZERO
    ] = 0.0
    viscous_friction: Annotated[
        float, at.Ge(0), Quantity("N m s", "viscous friction at the drum", "A5"), Mark.OFF_AT_ZERO
    ] = 0.0
    layer_thickness: Annotated[
        float,
        at.Ge(0),
        at.Le(0.5),
        Quantity("m", "growth of the radius by a full layer of rope; 0: one layer", "assumption"),
        Mark.OFF_AT_ZERO,
    ] = 0.0
    layer_laps: Annotated[float, at.Ge(1), Quantity("1", "drum turns that fill a layer", "assumption"), Mark.COURSE] = (
        20.0
    )
    radius_error: Annotated[
        float,
        at.Ge(-0.5),
        at.Le(0.5),
        Quantity("1", "share by which the radius is larger than drum_radius", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    eccentricity: Annotated[
        float,
        at.Ge(0),
        at.Le(0.1),
        Quantity("m", "distance of the drum's centre from its axis", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    eccentricity_angle: Annotated[
        float,
        Quantity("rad", "angle of the drum's largest radius at drum angle 0", "assumption"),
        Mark.UNKNOWN,
        Mark.COURSE,
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
        float,
        at.Ge(0),
        at.Le(1),
        Quantity("1", "amplitude of the torque's ripple, as a share of the torque", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    ripple_waves: Annotated[
        float, at.Ge(0), Quantity("1", "waves of the ripple a motor turn", "assumption"), Mark.UNKNOWN, Mark.COURSE
    ] = 6.0
    ripple_angle: Annotated[
        float, Quantity("rad", "phase of the ripple at drum angle 0", "assumption"), Mark.UNKNOWN, Mark.COURSE
    ] = 0.0

    rules: ClassVar = (
        Rule(
            ("eccentricity", "drum_radius"),
            lambda winch: winch.eccentricity <= winch.drum_radius / 4,
            lambda winch, _: f"must be <= {winch.drum_radius / 4:g} m (a quarter of drum_radius)",
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
    omega: Scalar, tension: Scalar, torque: Scalar, winch: Winch, radius: Scalar | None = None
) -> Scalar:
    """Acceleration of the drum in rad/s² (paper Section 2.4, E3).

    Args:
        omega: drum speed in rad/s.
        tension: rope tension in N.
        torque: motor torque in N m, before the gearbox.
        winch: the winch.
        radius: on which the rope leaves the drum, in m (`model.winding`; default: its drum_radius).
    """
    lever = winch.drum_radius if radius is None else radius
    drive = winch.gear_ratio * torque - lever * tension - friction_torque(omega, winch)
    return drive / winch.inertia


def shaft_torque(torque: Scalar, theta: Scalar, winch: Winch) -> Scalar:
    """Torque in N m that a motor gives instead of `torque`, at the drum angle theta in rad: its error, its ripple."""
    wave = sin(winch.ripple_waves * winch.gear_ratio * theta + winch.ripple_angle)
    return torque * (1 + winch.torque_error + winch.torque_ripple * wave)


def specified_winch(winch: Winch) -> Winch:
    """The winch of the data sheet, without what is unknown of it."""
    return replace(winch, radius_error=0.0, eccentricity=0.0, torque_error=0.0, torque_ripple=0.0)
