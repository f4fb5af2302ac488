"""Winch: motor, gearbox and drum; positive in the direction that retrieves rope (paper Section 2.4, E1)."""

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, tanh


@dataclass(frozen=True)
class Winch:
    """One winch."""

    inertia: Annotated[float, at.Gt(0), Quantity("kg m^2", "inertia at the drum", "Table 1")] = 1.8
    drum_radius: Annotated[float, at.Gt(0), Quantity("m", "radius of the drum", "Table 1")] = 0.8
    gear_ratio: Annotated[float, at.Gt(0), Quantity("1", "motor turns a drum turn", "Table 1")] = 36.0
    coulomb_friction: Annotated[
        float, at.Ge(0), Quantity("N m", "Coulomb friction at the drum", "A5"), Mark.OFF_AT_ZERO
    ] = 0.0
    viscous_friction: Annotated[
        float, at.Ge(0), Quantity("N m s", "viscous friction at the drum", "A5"), Mark.OFF_AT_ZERO
    ] = 0.0


FRICTION_SPEED = 0.01
"""Drum speed in rad/s over which the Coulomb friction changes its sign (A5)."""


def friction_torque(omega: Scalar, winch: Winch) -> Scalar:
    """Friction torque tau_f in N m at the drum speed omega in rad/s (A5)."""
    return winch.coulomb_friction * tanh(omega / FRICTION_SPEED) + winch.viscous_friction * omega


def friction_slope(omega: Scalar, winch: Winch) -> Scalar:
    """Slope of `friction_torque` over the drum speed in N m s."""
    steepness = 1 - tanh(omega / FRICTION_SPEED) ** 2
    return winch.coulomb_friction / FRICTION_SPEED * steepness + winch.viscous_friction


def drum_acceleration(omega: Scalar, tension: Scalar, torque: Scalar, winch: Winch) -> Scalar:
    """Acceleration of the drum in rad/s² (paper Section 2.4, E3).

    Args:
        omega: drum speed in rad/s.
        tension: rope tension in N.
        torque: motor torque in N m, before the gearbox.
        winch: the winch.
    """
    drive = winch.gear_ratio * torque - winch.drum_radius * tension - friction_torque(omega, winch)
    return drive / winch.inertia
