"""Ropes with mass and weight, gearboxes that give: against formulas of textbooks, worked out here once more."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

from dualwinch.model.heavy_ropes import Sag, span_of, transverse_mass
from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    PlantState,
    Torques,
    derivative,
    holding_torques,
    resting_state,
    tensions,
)
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.ropes import Rope, Track
from dualwinch.model.vehicle import Vehicle
from dualwinch.model.winch import Winch, cell_tension, tension_beyond_sheaves

STIFFNESS = 80e9 * 4.52e-4
"""E A in N of Table 1."""

CLAMPED = Vehicle(mass=1e15)
"""A vehicle that nothing moves."""


def plant_of(rope: Rope, winch: Winch, spacing: float = 0.0, vehicle: Vehicle = CLAMPED) -> Plant:
    return Plant(
        rope_slack=False,
        vehicle=vehicle,
        track=Track(roller_spacing=spacing),
        rope_1=rope,
        rope_2=rope,
        winch_1=winch,
        winch_2=winch,
    )


def linear(plant: Plant, tension: float, x: float) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the states, their rates at rest, and the Jacobian there."""
    rest = resting_state(2 * tension, plant, x)
    names = list(leaves(rest))
    symbols = ca.SX.sym("state", len(names))
    state = with_leaves(rest, dict(zip(names, ca.vertsplit(symbols), strict=True)))
    rates = derivative(state, holding_torques(2 * tension, plant), DisturbanceInputs(), plant)
    vector = ca.vertcat(*leaves(rates).values())
    function = ca.Function("linear", [symbols], [vector, ca.densify(ca.jacobian(vector, symbols))])
    value, slope = function(ca.vertcat(*leaves(rest).values()))
    return names, np.array(value).ravel(), np.array(slope)


def frequencies(plant: Plant, tension: float, x: float) -> np.ndarray:
    """Natural frequencies in Hz of what swings, in rising order."""
    _, _, slope = linear(plant, tension, x)
    values = np.linalg.eigvals(slope)
    return np.sort(np.abs(values[values.imag > 1e-3])) / (2 * math.pi)


@pytest.mark.parametrize("length", [20.5, 50.5])
def test_loss_factor_damps_the_first_mode_alike_at_all_lengths(length: float) -> None:
    rope = Rope(mass_per_length=2.36, segments=16, shortest_mass=0.0, damping=0.0, loss_factor=0.02)
    plant = replace(plant_of(rope, Winch(inertia=1e-6)), track=Track(length=length - 0.5))
    _, _, slope = linear(plant, 1000.0, 0.0)
    values = np.linalg.eigvals(slope)
    first = min(values[values.imag > 1e-3], key=abs)
    assert -first.real / abs(first) == pytest.approx(0.01, rel=0.01)  # half the loss factor


def test_rest_is_an_equilibrium() -> None:
    rope = Rope(mass_per_length=2.36, submerged_weight=20.2, added_mass_per_length=0.6, segments=4)
    winch = Winch(inertia=120.0, rotor_inertia=0.02, gear_stiffness=1.4e6, backlash=1e-3, transmission_error=1e-4)
    plant = plant_of(rope, winch, spacing=1.0, vehicle=Vehicle())
    names, rates, _ = linear(plant, 1000.0, 17.0)
    assert dict(zip(names, np.abs(rates) < 1e-5, strict=True)) == dict.fromkeys(names, True)
    assert tensions(resting_state(2000.0, plant, 17.0), plant) == pytest.approx((1000.0, 1000.0))


def test_sag_hangs_as_a_parabola_between_rollers() -> None:
    rope = Rope(submerged_weight=20.2, added_mass_per_length=2.96)
    state = resting_state(2000.0, plant_of(rope, Winch(), spacing=1.0), 25.0)
    assert isinstance(state.rope_1.sag, Sag)
    assert state.rope_1.sag.depth == pytest.approx(20.2 * 1.0**2 / (8 * 1000))
    assert span_of(0.5, Track(roller_spacing=1.0)) == 0.5
    assert span_of(30.0, Track()) == 30.0


def test_shortening_of_one_span_is_the_catenarys() -> None:
    """The parabola's arc over its chord, against the catenary's, for 5 m at 500 N."""
    weight, span, tension = 20.2, 5.0, 500.0
    rope = Rope(submerged_weight=weight, added_mass_per_length=2.96, modulus=1e15)
    plant = plant_of(rope, Winch(), spacing=span)
    shortening = 25.0 - resting_state(2 * tension, plant, 25.0).theta_1 * 0.8
    catenary = 2 * tension / weight * math.sinh(weight * span / (2 * tension)) / span - 1
    assert shortening / 25.5 == pytest.approx(catenary, rel=2e-3)


@pytest.mark.parametrize("tension", [1000.0, 3000.0, 6000.0])
def test_first_symmetric_frequency_is_irvines(tension: float) -> None:
    """One span between a fixed drum and a fixed vehicle, against Irvine's transcendental equation (lambda² < 15)."""
    span = 0.75
    rope = Rope(submerged_weight=20.2, added_mass_per_length=2.96, damping=0.0)
    found = frequencies(plant_of(rope, Winch(inertia=1e12), spacing=span), tension, 25.0)
    square = (20.2 * span) ** 2 * STIFFNESS / tension**3

    def irvine(omega: float) -> float:
        return math.tan(omega / 2) - omega / 2 + 4 / square * (omega / 2) ** 3

    omega = root_scalar(irvine, bracket=(math.pi * (1 + 1e-9), 2 * math.pi)).root
    expected = omega / (2 * math.pi * span) * math.sqrt(tension / 2.96)
    assert square < 15
    assert min(found, key=lambda hertz: abs(hertz - expected)) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("mass", "segments"), [(2.36, 2), (2.36, 4), (0.0, 1)])
def test_a_slack_rope_that_moves_away_from_its_drum_gives_half_a_segments_drag(mass: float, segments: int) -> None:
    rope = Rope(mass_per_length=mass, segments=segments, skin_friction=0.01)
    plant = replace(plant_of(rope, Winch()), rope_slack=True)
    rest = resting_state(2000.0, plant, 10.0)
    paid_out = replace(rest, theta_1=rest.theta_1 - 1.0, omega_1=-10.0)
    speed = 10.0 * plant.winch_1.drum_radius / 2  # of the segment at the drum, whose other end is at rest
    drag = 0.5 * plant.vehicle.water_density * 0.01 * math.pi * rope.diameter * 40.5 * speed**2
    assert tensions(rest, plant)[0] == pytest.approx(1000.0)
    assert tensions(paid_out, plant)[0] == pytest.approx(-drag / (2 * segments))


def test_gearbox_and_rope_are_two_masses_on_two_springs() -> None:
    winch = Winch(inertia=120.0, rotor_inertia=0.02, gear_stiffness=1.4e6)
    found = frequencies(plant_of(Rope(damping=0.0), winch), 1000.0, 25.0)
    rotor, gear, rope = 0.02 * 36**2, 1.4e6, STIFFNESS / 25.5 * 0.8**2
    stiffness = np.array([[gear, -gear], [-gear, gear + rope]])
    squares = np.linalg.eigvals(np.linalg.solve(np.diag([rotor, 120.0]), stiffness))
    # both winches have nearly the same: ropes of 25.5 m
    assert found[::2] == pytest.approx(np.sort(np.sqrt(squares)) / (2 * math.pi), rel=1e-6)


def test_rope_on_the_drum_adds_its_inertia() -> None:
    """With the vehicle at 40 m, rope 1 is 10.5 m long and 40 m of it lie on the drum; a segment's half hangs there."""
    rope = Rope(mass_per_length=2.0, segments=1, shortest_mass=0.0, spare_length=7.0, damping=0.0)
    plant = plant_of(rope, Winch())
    rest = resting_state(2000.0, plant, 40.0)
    extra = Torques(*(1.1 * torque for torque in leaves(holding_torques(2000.0, plant)).values()))
    alpha = derivative(rest, extra, DisturbanceInputs(), plant).omega_1
    mass = 2.0 * (40.0 + 7.0) + 2.0 * 10.5 / 2
    assert alpha == pytest.approx(0.1 * 0.8 * 1000 / (1.8 + mass * 0.8**2), rel=1e-9)


@pytest.mark.parametrize("twist", [-3e-3, -5e-4, 0.0, 5e-4, 3e-3])
def test_teeth_part_within_the_backlash(twist: float) -> None:
    winch = Winch(rotor_inertia=0.02, gear_stiffness=1.4e6, backlash=2e-3)
    plant = plant_of(Rope(), winch)
    rest = resting_state(2000.0, plant, 25.0)
    state = replace(rest, motor_1=replace(rest.motor_1, theta=rest.theta_1 + twist))
    alpha = derivative(state, Torques(0.0, 0.0), DisturbanceInputs(), plant).omega_1
    torque = 1.4e6 * (twist - math.copysign(1e-3, twist)) if abs(twist) > 1e-3 else 0.0
    assert alpha == pytest.approx((torque - 0.8 * 1000) / 1.8, rel=1e-9)


@pytest.mark.parametrize("omega", [-1.0, 1.0])
def test_gear_loss_is_friction_in_proportion_to_the_load(omega: float) -> None:
    plant = plant_of(Rope(damping=0.0), Winch(gear_loss=0.05))
    rest = replace(resting_state(2000.0, plant, 25.0), omega_1=omega)
    alpha = derivative(rest, holding_torques(2000.0, plant), DisturbanceInputs(), plant).omega_1
    assert alpha == pytest.approx(-math.copysign(0.05 * 0.8 * 1000 / 1.8, omega), rel=1e-6)


@pytest.mark.parametrize("omega", [-1.0, 1.0])
def test_the_side_towards_which_a_rope_slides_over_its_sheave_has_more_tension(omega: float) -> None:
    plant = plant_of(Rope(damping=0.0), Winch(sheave_friction=0.04))
    rest = replace(resting_state(2000.0, plant, 25.0), omega_1=omega)
    alpha = derivative(rest, holding_torques(2000.0, plant), DisturbanceInputs(), plant).omega_1
    factor = math.exp(math.copysign(0.04, omega))
    assert alpha == pytest.approx(0.8 * 1000 * (1 - factor) / 1.8, rel=1e-6)


@pytest.mark.parametrize(("beyond", "factor"), [(0.0, math.exp(0.04)), (0.5, math.exp(0.02)), (1.0, 1.0)])
def test_a_load_cell_reads_the_tension_where_it_sits(beyond: float, factor: float) -> None:
    winch = Winch(sheave_friction=0.04, cell_beyond=beyond)
    assert cell_tension(1000.0, 2.0, winch) == pytest.approx(1000 * factor)
    assert cell_tension(1000.0, -2.0, winch) == pytest.approx(1000 / factor)
    assert tension_beyond_sheaves(cell_tension(1000.0, 0.003, winch), 0.003, winch) == pytest.approx(1000)


def energy(state: PlantState, plant: Plant) -> float:
    """Energy in J of a plant whose vehicle stands and whose motors give nothing."""
    rope: Any = plant.rope_1
    total = 0.0
    for number, sign in ((1, 1), (2, -1)):
        inner, theta = getattr(state, f"rope_{number}"), getattr(state, f"theta_{number}")
        omega, length = getattr(state, f"omega_{number}"), 25.5
        way, mass = sign * state.x, rope.mass_per_length * length / rope.segments
        nodes = [0.8 * theta, *np.atleast_1d(inner.waves.position), way]
        surplus = 8 / 3 * inner.sag.depth**2 * length / rope.segments
        spring = rope.segments * STIFFNESS / length
        total += sum(spring / 2 * (a - b + surplus) ** 2 for a, b in pairwise(nodes))
        drum = 1.8 / 0.8**2 + mass / 2 + rope.mass_per_length * 25.0
        total += drum / 2 * (0.8 * omega) ** 2 + sum(mass / 2 * speed**2 for speed in np.atleast_1d(inner.waves.speed))
        total += length * (8 / 15 * 2.96 / 2 * inner.sag.rate**2 - 2 / 3 * 20.2 * inner.sag.depth)
    return total


def test_waves_and_sag_neither_gain_nor_lose_energy() -> None:
    """A plucked rope without damping, solved finely by a method that has nothing to do with those of the product."""
    rope = Rope(mass_per_length=2.36, submerged_weight=20.2, added_mass_per_length=0.6, segments=3, damping=0.0)
    plant = plant_of(rope, Winch(), spacing=1.0)
    rest = resting_state(2000.0, plant, 25.0)
    names = list(leaves(rest))
    start = np.array(list(leaves(replace(rest, omega_1=0.02)).values()))

    def rates(_: float, values: np.ndarray) -> list[float]:
        state = with_leaves(rest, dict(zip(names, values, strict=True)))
        moved = derivative(state, Torques(0.0, 0.0), DisturbanceInputs(), plant)
        return [float(value) for value in leaves(moved).values()]

    found = solve_ivp(rates, (0.0, 0.02), start, rtol=1e-10, atol=1e-12)
    end = with_leaves(rest, dict(zip(names, found.y[:, -1], strict=True)))
    before = energy(with_leaves(rest, dict(zip(names, start, strict=True))), plant)
    assert energy(end, plant) == pytest.approx(before, abs=1e-4)
    assert abs(end.omega_1 - 0.02) > 1e-3


def test_a_rope_that_sags_without_mass_of_its_own_has_that_of_a_wire_rope() -> None:
    assert transverse_mass(Rope(submerged_weight=20.2)) == pytest.approx(2.36, rel=0.01)
    assert transverse_mass(Rope(submerged_weight=20.2, added_mass_per_length=2.96)) == 2.96
    assert transverse_mass(Rope(submerged_weight=20.2, mass_per_length=2.36, added_mass_per_length=0.6)) == 2.36 + 0.6
