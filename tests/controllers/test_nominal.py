from dataclasses import replace

from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.model.plant import Plant
from dualwinch.model.vehicle import Vehicle, inertia

PLANT = Plant(vehicle=Vehicle(mass=1.1e4, added_mass=3e3))


def test_by_default_the_controller_assumes_the_plant() -> None:
    assert nominal_plant(Nominal(), PLANT) == PLANT


def test_a_nominal_mass_is_the_whole_mass() -> None:
    assert inertia(nominal_plant(Nominal(mass=9e3), PLANT).vehicle) == 9e3


def test_only_what_is_given_differs() -> None:
    nominal = nominal_plant(Nominal(drag_coefficient=0.5, friction_coefficient=0.2), PLANT)
    vehicle = replace(PLANT.vehicle, drag_coefficient=0.5, friction_coefficient=0.2)
    assert nominal == replace(PLANT, vehicle=vehicle)
