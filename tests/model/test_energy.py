"""With torques off and no disturbance the plant only loses mechanical energy.

The rope's stiffness k = E A / length depends on the vehicle's position, while its force k * stretch is not the
derivative of k * stretch²/2 by position: rope that is reeled in carries its strain energy onto the drum, rope that is
paid out brings some back. That adds the power v * (F1 strain_1 - F2 strain_2)/2 of the springs, with strain =
stretch/length below 2e-4. It is the only way the sum of kinetic and spring energy can grow; without it the sum falls.
"""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques, derivative
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import Rope, Track, kelvin_voigt, rope_lengths, stiffness
from dualwinch.model.winch import Winch
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem

OFF = Torques(0.0, 0.0)
ROUGH_WINCH = Winch(coulomb_friction=20.0, viscous_friction=3.0)
PLANT = Plant(winch_1=ROUGH_WINCH, winch_2=ROUGH_WINCH)


def springs(state: PlantState, plant: Plant) -> list[tuple[float, float, float, float]]:
    """Rate (N/m), stretch (m, 0 while loose), stretch rate (m/s) and length (m) of both ropes."""
    lengths = rope_lengths(state.x, plant.track)
    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    stretches = max(radius_1 * state.theta_1 - state.x, 0.0), max(radius_2 * state.theta_2 + state.x, 0.0)
    rates = radius_1 * state.omega_1 - state.v, radius_2 * state.omega_2 + state.v
    ropes = kelvin_voigt(plant.rope_1), kelvin_voigt(plant.rope_2)
    return [
        (stiffness(length, rope), stretch, rate, length)
        for length, rope, stretch, rate in zip(lengths, ropes, stretches, rates, strict=True)
    ]


def energy(state: PlantState, plant: Plant) -> float:
    """Kinetic energy and that of stretched ropes in J."""
    kinetic = plant.vehicle.mass * state.v**2
    kinetic += plant.winch_1.inertia * state.omega_1**2 + plant.winch_2.inertia * state.omega_2**2
    return (kinetic + sum(k * stretch**2 for k, stretch, _, _ in springs(state, plant))) / 2


def reeled_power(state: PlantState, plant: Plant) -> float:
    """Power in W by which the springs gain because their lengths change."""
    (k_1, stretch_1, _, length_1), (k_2, stretch_2, _, length_2) = springs(state, plant)
    return state.v / 2 * (k_1 * stretch_1**2 / length_1 - k_2 * stretch_2**2 / length_2)


def energy_rate(state: PlantState, plant: Plant) -> tuple[float, float]:
    """Rate of `energy` in W by the equations of motion, and the sum of its terms' sizes."""
    slope = derivative(state, OFF, DisturbanceInputs(), plant)
    terms = [
        plant.vehicle.mass * state.v * slope.v,
        plant.winch_1.inertia * state.omega_1 * slope.omega_1,
        plant.winch_2.inertia * state.omega_2 * slope.omega_2,
        *(k * stretch * rate for k, stretch, rate, _ in springs(state, plant)),
        reeled_power(state, plant),
    ]
    return sum(terms), sum(abs(term) for term in terms)


@st.composite
def states(draw: st.DrawFn, plant: Plant) -> PlantState:
    x, v = draw(st.floats(1, 49)), draw(st.floats(-3, 3))
    pulls, slips = draw(st.tuples(*2 * [st.floats(-500, 8000)])), draw(st.tuples(*2 * [st.floats(-1, 1)]))
    length_1, length_2 = rope_lengths(x, plant.track)
    stretch_1, stretch_2 = (
        plant.rope_1.resting_stretch(pulls[0], length_1),
        plant.rope_2.resting_stretch(pulls[1], length_2),
    )
    return PlantState(x, v, (stretch_1 + x) / 0.8, (v + slips[0]) / 0.8, (stretch_2 - x) / 0.8, (slips[1] - v) / 0.8)


@given(states(PLANT))
def test_energy_falls_but_for_the_strain_of_reeled_rope(state: PlantState) -> None:
    rate, size = energy_rate(state, PLANT)
    assert rate - reeled_power(state, PLANT) <= 1e-9 * size


@given(states(PLANT))
def test_strain_of_reeled_rope_is_a_small_part_of_the_ropes_power(state: PlantState) -> None:
    ropes = sum(k * stretch * abs(state.v) for k, stretch, _, _ in springs(state, PLANT))
    assert abs(reeled_power(state, PLANT)) <= 2e-4 * ropes + 1e-12


FIXED = replace(PLANT, track=Track(rope_offset=1e6))
"""Ropes so long that their lengths do not change, as stiff as those in the middle of the track."""
FIXED = replace(
    FIXED,
    rope_1=Rope(modulus=80e9 * 1e6 / 25.5),
    rope_2=Rope(modulus=80e9 * 1e6 / 25.5),
)


@cache
def one_sample(name: str) -> ca.Function:
    """``state -> state`` one millisecond later, torques off, in fine sub-steps."""
    x = ca.SX.sym("x", 6)
    problem = Problem(0.0, 1e-3, OFF, DisturbanceInputs(), Disturbance(), FIXED)
    after = INTEGRATORS[name].advance(problem, Motion(PlantState(*ca.vertsplit(x))), 16).plant
    return ca.Function("sample", [x], [ca.vertcat(*leaves(after).values())])


@pytest.mark.parametrize("name", INTEGRATORS)
@settings(max_examples=25)
@given(state=states(FIXED))
def test_energy_of_ropes_of_fixed_length_never_grows_along_a_run(name: str, state: PlantState) -> None:
    path = np.array(one_sample(name).mapaccum(200)(np.array(list(leaves(state).values()))))
    energies = np.array([energy(state, FIXED), *(energy(PlantState(*point), FIXED) for point in path.T)])
    assert np.diff(energies).max() <= 1e-7 * energies[0] + 1e-9
