"""The underwater vehicle and what holds it back: rail friction and drag (paper Section 2.3)."""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity
from dualwinch.model.scalar import Scalar, absolute, tanh


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
    normal_force: Annotated[NonNegative, Quantity("N", "mean force on the rail", "Table 1"), Mark.OFF_AT_ZERO] = 4.9e3
    friction_coefficient: Annotated[
        NonNegative, Quantity("1", "Coulomb friction on the rail", "A3"), Mark.OFF_AT_ZERO
    ] = 0.1
    friction_velocity: Annotated[Positive, Quantity("m/s", "speed over which friction changes its sign", "A3")] = 0.01


def inertia(vehicle: Vehicle) -> Scalar:
    """Mass in kg that the ropes accelerate."""
    return vehicle.mass + vehicle.added_mass


def friction(v: Scalar, vehicle: Vehicle, normal_force_variation: Scalar = 0.0) -> Scalar:
    """Rail friction F_f in N at the speed v in m/s; opposes motion (paper Section 2.3, E2, A3)."""
    normal_force = vehicle.normal_force + normal_force_variation
    return vehicle.friction_coefficient * normal_force * tanh(v / vehicle.friction_velocity)


def drag(v: Scalar, vehicle: Vehicle) -> Scalar:
    """Drag F_w in N at the speed v in m/s through the water; opposes motion (paper Section 2.3, E2, A4)."""
    return 0.5 * vehicle.drag_coefficient * vehicle.water_density * vehicle.drag_area * v * absolute(v)
