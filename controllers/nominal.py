"""The controller's own idea of the plant, which may differ from the plant."""

from dataclasses import dataclass, replace
from typing import Annotated

import annotated_types as at

from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity


@dataclass(frozen=True)
class Nominal:
    """Values the controller believes; what is not given is taken from the plant."""

    mass: Annotated[
        float | None,
        at.Gt(0),
        Quantity("kg", "believed mass (default: plant's mass + added_mass)", "assumption"),
    ] = None
    drag_coefficient: Annotated[
        float | None,
        at.Ge(0),
        Quantity("1", "believed drag coefficient (default: the plant's)", "assumption"),
    ] = None
    friction_coefficient: Annotated[
        float | None, at.Ge(0), Quantity("1", "believed rail friction (default: the plant's)", "assumption")
    ] = None


def nominal_plant(nominal: Nominal, plant: Plant) -> Plant:
    """The plant as the controller believes it to be."""
    vehicle = plant.vehicle
    if nominal.mass is not None:
        vehicle = replace(vehicle, mass=nominal.mass, added_mass=0.0)
    if nominal.drag_coefficient is not None:
        vehicle = replace(vehicle, drag_coefficient=nominal.drag_coefficient)
    if nominal.friction_coefficient is not None:
        vehicle = replace(vehicle, friction_coefficient=nominal.friction_coefficient)
    return replace(plant, vehicle=vehicle)
