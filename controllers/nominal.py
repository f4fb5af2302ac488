"""The nominal model: the controller's own model of the plant, and the forces that it compensates."""

from dataclasses import dataclass, replace
from typing import Annotated

import annotated_types as at

from dualwinch.model.linear.operating_point import PRELOAD
from dualwinch.model.plant import Plant, specified_plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.ropes import Rope, tangent_rope
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import drag, friction, inertia


@dataclass(frozen=True)
class Nominal:
    """Values of the nominal model; default: those of the plant."""

    mass: Annotated[
        float | None, at.Gt(0), Quantity("kg", "nominal mass (default: plant's mass + added_mass)", "assumption")
    ] = None
    drag_coefficient: Annotated[
        float | None, at.Ge(0), Quantity("1", "nominal drag coefficient (default: the plant's)", "assumption")
    ] = None
    friction_coefficient: Annotated[
        float | None, at.Ge(0), Quantity("1", "nominal rail friction (default: the plant's)", "assumption")
    ] = None


def nominal_plant(nominal: Nominal, plant: Plant, preload: float = PRELOAD) -> Plant:
    """The nominal plant: that of the data sheets, without unknown errors, with Kelvin–Voigt ropes.

    A rope of another law is replaced by its tangent at half the preload in N, in the middle of the track.
    """
    plant, overrides = specified_plant(plant), {key: value for key, value in vars(nominal).items() if value is not None}
    vehicle = replace(plant.vehicle, **overrides | ({"added_mass": 0.0} if "mass" in overrides else {}))
    length = plant.track.length / 2 + plant.track.rope_offset
    rope_1, rope_2 = (tangent_rope(rope, preload / 2, length) for rope in (plant.rope_1, plant.rope_2))
    return replace(plant, vehicle=vehicle, rope_1=rope_1, rope_2=rope_2)


def nominal_structure(plant: Plant) -> Plant:
    """Structure of the nominal plant; its numbers are placeholders."""
    return replace(specified_plant(plant), rope_1=Rope(), rope_2=Rope())


@dataclass(frozen=True)
class NominalForces:
    """Mass in kg and resistance in N of the nominal model."""

    mass: Scalar
    resistance: Scalar


def nominal_forces(v: Scalar, d: Scalar, nominal: Plant) -> NominalForces:
    """Mass in kg, and resistance F_f + F_w − mass d in N at the speed v in m/s, of the nominal model.

    `d` is a known disturbance acceleration in m/s².

    Example:
        >>> import dualwinch as dw
        >>> dw.nominal_forces(1.0, 0.0, dw.Plant())
        NominalForces(mass=10000.0, resistance=1390.0)
    """
    vehicle = nominal.vehicle
    mass = inertia(vehicle)
    return NominalForces(mass, friction(v, vehicle) + drag(v, vehicle) - mass * d)
