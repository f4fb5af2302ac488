"""The controller's own model of the plant, which may differ from the plant, and the forces it compensates by it."""

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
    """Values the controller believes; what is not given is taken from the plant."""

    mass: Annotated[
        float | None, at.Gt(0), Quantity("kg", "believed mass (default: plant's mass + added_mass)", "assumption")
    ] = None
    drag_coefficient: Annotated[
        float | None, at.Ge(0), Quantity("1", "believed drag coefficient (default: the plant's)", "assumption")
    ] = None
    friction_coefficient: Annotated[
        float | None, at.Ge(0), Quantity("1", "believed rail friction (default: the plant's)", "assumption")
    ] = None


def nominal_plant(nominal: Nominal, plant: Plant, preload: float = PRELOAD) -> Plant:
    """The plant as the controller believes it to be.

    It is that of the data sheets, without what is unknown of it. Its ropes are Kelvin–Voigt ones: of a rope of another
    law, the tangent at half the preload, amid the track.

    Args:
        nominal: what it believes.
        plant: gives the rest.
        preload: sum of both tensions in N.
    """
    plant, believed = specified_plant(plant), {key: value for key, value in vars(nominal).items() if value is not None}
    vehicle = replace(plant.vehicle, **believed | ({"added_mass": 0.0} if "mass" in believed else {}))
    length = plant.track.length / 2 + plant.track.rope_offset
    rope_1, rope_2 = (tangent_rope(rope, preload / 2, length) for rope in (plant.rope_1, plant.rope_2))
    return replace(plant, vehicle=vehicle, rope_1=rope_1, rope_2=rope_2)


def nominal_structure(plant: Plant) -> Plant:
    """What the controller's plant is made of, without what is unknown of it; its numbers are to be replaced."""
    return replace(specified_plant(plant), rope_1=Rope(), rope_2=Rope())


@dataclass(frozen=True)
class NominalForces:
    """Mass and resistance of the nominal model."""

    mass: Scalar
    resistance: Scalar


def nominal_forces(v: Scalar, d: Scalar, nominal: Plant) -> NominalForces:
    """Mass in kg and resistance F_f + F_w in N of the nominal model at the speed v in m/s, less a known disturbance.

    `d` is its acceleration in m/s².
    """
    vehicle = nominal.vehicle
    mass = inertia(vehicle)
    return NominalForces(mass, friction(v, vehicle) + drag(v, vehicle) - mass * d)
