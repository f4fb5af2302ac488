"""The underwater vehicle and its resistance: rail friction, the rail's slope and drag (paper Section 2.3).

Friction is Coulomb friction, smoothed about rest (A3), with the Stribeck effect where ``stiction`` is given. With
``bristle_stiffness`` it is LuGre friction (`model.friction`): the vehicle sticks and breaks away, and its steady-state
friction is the same Stribeck curve::

    F = sigma_0 z + sigma_1 dz/dt,    dz/dt = v − |v| z sigma_0/g(v),    g(v) = mu N (1 + stiction exp(−(v/v_s)²))
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any

from dualwinch.model.friction import bristle_rate
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity
from dualwinch.model.ropes import Track
from dualwinch.model.scalar import Scalar, absolute, exp, present, sign, sin, sqrt, tanh


@dataclass(frozen=True)
class Vehicle:
    """The towed vehicle on its rail."""

    mass: Annotated[Positive, Quantity("kg", "mass of the vehicle", "Table 1")] = 1e4
    added_mass: Annotated[NonNegative, Quantity("kg", "water that moves with the vehicle", "A6"), Mark.OFF_AT_ZERO] = (
        0.0
    )
    drag_coefficient: Annotated[NonNegative, Quantity("1", "drag coefficient", "Table 1"), Mark.OFF_AT_ZERO] = 0.3
    drag_area: Annotated[NonNegative, Quantity("m^2", "frontal area, diameter x height", "A4"), Mark.OFF_AT_ZERO] = 6.0
    diameter: Annotated[Positive, Quantity("m", "diameter, the length that sets the vortex frequency", "Table 1")] = 2.0
    height: Annotated[Positive, Quantity("m", "height of the vehicle", "Table 1")] = 3.0
    water_density: Annotated[NonNegative, Quantity("kg/m^3", "density of the water", "Table 1"), Mark.OFF_AT_ZERO] = (
        1000.0
    )
    cross_current: Annotated[
        NonNegative,
        Quantity("m/s", "speed of a steady current across the track; drag follows the whole flow", "A14"),
        Mark.SHAPES_CODE_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    normal_force: Annotated[NonNegative, Quantity("N", "mean force on the rail", "Table 1"), Mark.OFF_AT_ZERO] = 4.9e3
    friction_coefficient: Annotated[
        NonNegative, Quantity("1", "Coulomb friction on the rail", "A3"), Mark.OFF_AT_ZERO
    ] = 0.1
    friction_velocity: Annotated[Positive, Quantity("m/s", "speed over which friction changes its sign", "A3")] = 0.01
    stiction: Annotated[
        NonNegative,
        Quantity("1", "share by which friction at rest exceeds that of sliding", "0 to 0.5, A14"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    stribeck_velocity: Annotated[
        Positive,
        Quantity("m/s", "speed at which 1/e of stiction is left (Stribeck)", "0.01, A14"),
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 0.01
    bristle_stiffness: Annotated[
        NonNegative,
        Quantity("N/m", "stiffness of LuGre's bristles; 0: friction follows the speed at once", "5e6, A14"),
        Mark.SHAPES_CODE_AT_ZERO,
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 0.0
    bristle_damping: Annotated[
        NonNegative,
        Quantity("N s/m", "damping of LuGre's bristles", "1e5, A14"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 0.0


@dataclass(frozen=True)
class Bristles:
    """Bristles between the vehicle and its rail."""

    deflection: Annotated[Scalar, Quantity("m", "deflection of the bristles on the rail"), Mark.SETTLES]


def inertia(vehicle: Vehicle) -> Scalar:
    """Mass in kg that the ropes accelerate."""
    return vehicle.mass + vehicle.added_mass


def friction(v: Scalar, vehicle: Vehicle, normal_force_variation: Scalar = 0.0) -> Scalar:
    """Rail friction F_f in N at the speed v in m/s; opposes motion (paper Section 2.3, E2, A3, A14)."""
    direction = sign(v) if present(vehicle.bristle_stiffness) else tanh(v / vehicle.friction_velocity)
    return stribeck(v, vehicle, normal_force_variation) * direction


def stribeck(v: Scalar, vehicle: Vehicle, normal_force_variation: Scalar = 0.0) -> Scalar:
    """Magnitude in N of the rail friction in steady motion at the speed v in m/s: Stribeck's curve."""
    sliding = vehicle.friction_coefficient * (vehicle.normal_force + normal_force_variation)
    share = v / vehicle.stribeck_velocity
    return sliding * (1 + vehicle.stiction * exp(-share * share))


def slope_force(x: Scalar, vehicle: Vehicle, track: Track) -> Scalar:
    """Downhill force in N on a rail that rises towards winch 1, at the position x in m, for angles of at most 0.1 rad.

    The weight is the vehicle's net weight in water, which is the mean force on the rail.
    """
    return vehicle.normal_force * (track.tilt + track.waviness * sin(2 * math.pi / track.wavelength * x))


def bent_bristles(force: Scalar, vehicle: Vehicle) -> Any:
    """State of bristles under a constant force in N; `NO_STATE` without bristles."""
    return Bristles(force / vehicle.bristle_stiffness) if present(vehicle.bristle_stiffness) else NO_STATE


def rail_friction(
    v: Scalar, bristles: Any, vehicle: Vehicle, normal_force_variation: Scalar, step: Scalar
) -> tuple[Scalar, Any]:
    """Rail friction in N, and the mean rate of the bristles' state over a step (`bristle_rate`).

    The friction is that of the bristles at the end of the step (semi-implicit: they move before the vehicle).
    """
    if not isinstance(bristles, Bristles):
        return friction(v, vehicle, normal_force_variation), bristles
    limit = stribeck(v, vehicle, normal_force_variation) / vehicle.bristle_stiffness
    rate = bristle_rate(bristles.deflection, v, limit, step)
    bent = bristles.deflection + step * rate
    return vehicle.bristle_stiffness * bent + vehicle.bristle_damping * rate, Bristles(rate)


def drag(v: Scalar, vehicle: Vehicle) -> Scalar:
    """Drag F_w in N at the speed v in m/s through the water; opposes motion (paper Section 2.3, E2, A4).

    With a current across the track, the component along the track of the drag on the whole flow (Morison's equation).
    """
    across = vehicle.cross_current
    flow = sqrt(v * v + across * across) if present(across) else absolute(v)
    return 0.5 * vehicle.drag_coefficient * vehicle.water_density * vehicle.drag_area * v * flow
