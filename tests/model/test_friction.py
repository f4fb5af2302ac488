"""Friction with memory against what textbooks and papers say of it: LuGre's on the rail, Dahl's in the ropes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dualwinch.model.heavy_ropes import Hysteresis, RopeEnds, RopeState, resting_rope, rope_pull
from dualwinch.model.plant import DisturbanceInputs, Plant, derivative, holding_torques, resting_state
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import Rope, Track
from dualwinch.model.vehicle import Bristles, Vehicle, rail_friction

COULOMB, STIFF, DAMPING = 490.0, 5e6, 1e5
LUGRE = Vehicle(stiction=0.5, stribeck_velocity=0.01, bristle_stiffness=STIFF, bristle_damping=DAMPING)
"""A rail on which 490 N of friction are 735 N at break-away."""

STEP = 2.5e-4
"""In s, of an integrator; in cruise bristles settle in a fifth of it."""


def forces(speeds: np.ndarray, step: float = STEP) -> np.ndarray:
    """Friction in N along a motion whose speed is constant in each step, from bristles at rest."""
    bristles, found = Bristles(0.0), []
    for v in speeds:
        force, rate = rail_friction(float(v), bristles, LUGRE, 0.0, step)
        bristles = Bristles(bristles.deflection + step * rate.deflection)
        found.append(float(force))
    return np.array(found)


def stribeck(v: float) -> float:
    """Size of the friction in steady motion (Canudas de Wit et al. 1995, Eq. 5)."""
    return COULOMB * (1 + 0.5 * math.exp(-((v / 0.01) ** 2)))


@pytest.mark.parametrize("v", [1e-3, 5e-3, 0.01, 0.03, 0.5, 1.8, -0.02, -1.8])
def test_friction_in_steady_motion_is_stribecks_curve(v: float) -> None:
    assert forces(np.full(10000, v))[-1] == pytest.approx(math.copysign(stribeck(v), v), rel=1e-6)


def test_at_rest_bristles_are_a_spring() -> None:
    """Within a micrometre: sigma_0 x, and none of it lost on the way back."""
    speeds = np.concatenate([np.full(40, 1e-4), np.zeros(40)])
    assert forces(speeds)[-1] == pytest.approx(STIFF * 1e-6, rel=5e-3)


def test_break_away_is_near_the_friction_at_rest() -> None:
    """The speed rises by 1 mm/s²: the largest force is F_s, and a little of sigma_1."""
    assert 1.45 * COULOMB < forces(np.arange(0, 6e-3, 1e-3 * STEP)).max() < 1.52 * COULOMB


def test_friction_to_and_fro_is_that_of_the_differential_equation() -> None:
    """SciPy's solution of LuGre's equations through two reversals of the motion."""

    def speed(t: Any) -> Any:
        return 2e-2 * np.sin(2 * np.pi * t)

    def slope(t: float, z: np.ndarray) -> np.ndarray:
        return speed(t) - STIFF * abs(speed(t)) / stribeck(speed(t)) * z

    t = np.arange(0.0, 1.5, STEP)
    z = solve_ivp(slope, (0.0, 1.5), [0.0], method="LSODA", t_eval=t[1:], rtol=1e-8, atol=1e-14).y[0]
    rate = np.array([float(slope(at, bent)) for at, bent in zip(t[1:], z, strict=True)])
    found = forces(speed(t[1:] - STEP / 2))
    assert np.abs(found - (STIFF * z + DAMPING * rate)).max() < 0.02 * COULOMB


def test_bristles_stay_within_their_limit_whatever_the_step() -> None:
    bristles = Bristles(0.0)
    for v in (1.8, -1.8, 30.0, -1e4, 0.0, 1e-9):
        _, rate = rail_friction(v, bristles, LUGRE, 0.0, 0.1)
        bristles = Bristles(bristles.deflection + 0.1 * rate.deflection)
        assert abs(bristles.deflection) <= 1.5 * COULOMB / STIFF
    force, _ = rail_friction(1.8, Bristles(0.0), replace(LUGRE, friction_coefficient=0.0), 0.0, STEP)
    assert abs(force) < 1e-3


def test_bristles_hold_the_vehicle_on_a_slope() -> None:
    """49 N of slope and 4.9 N of wave: 10 µm of bristles, and nothing moves."""
    plant = Plant(vehicle=LUGRE, track=Track(tilt=1e-2, waviness=1e-3, wavelength=10.0))
    state = resting_state(2000.0, plant, 12.5)
    assert state.rail.deflection == pytest.approx(-4900 * 11e-3 / STIFF)
    rates = derivative(state, holding_torques(2000.0, plant), DisturbanceInputs(), plant)
    assert max(abs(float(rate)) for rate in leaves(rates).values()) < 1e-9


FORCE, STRAIN, LENGTH, SPRING = 7.0, 4e-6, 50.5, 80e9 * 4.52e-4 / 50.5
ROPE = Rope(damping=0.0, hysteresis=FORCE, hysteresis_strain=STRAIN)


def pulled(ways: np.ndarray, rope: Rope = ROPE, step: float = 1e-4) -> np.ndarray:
    """Tensions in N of a rope between a fixed vehicle and a drum that winds these ways in m, a step each."""
    rest, stretch = resting_rope(rope, 1000.0, LENGTH, Track(), 0.0)
    state, found, before = rest, [], 0.0
    for way in ways:
        rate = (way - before) / step
        ends = RopeEnds(stretch + way, rate, stretch + way, rate, LENGTH, 1 / LENGTH)
        pull = rope_pull(rope, state, ends, Track(), density=1000.0, slack=True, step=step)
        assert isinstance(state.hysteresis, Hysteresis)
        state, before = (
            RopeState(hysteresis=Hysteresis(state.hysteresis.share + step * pull.rate.hysteresis.share)),
            way,
        )
        found.append(float(pull.at_drum))
    return np.array(found)


@pytest.mark.parametrize("size", [5e-5, 2e-4, 5e-4])
def test_a_cycle_loses_what_dahls_loop_encloses(size: float) -> None:
    """4 T (a − d tanh(a/d)), to and fro by a: a loss factor of 0.015 at 0.2 mm."""
    ways = size * np.sin(2 * np.pi * np.arange(9000) / 3000)
    tension = pulled(ways)
    last = slice(5999, 9000)
    enclosed = np.trapezoid(tension[last], ways[last])
    way = STRAIN * LENGTH
    lost = 4 * FORCE * (size - way * math.tanh(size / way))
    assert enclosed == pytest.approx(lost, rel=0.01)
    if size == 2e-4:
        assert lost / (math.pi * SPRING * size**2) == pytest.approx(0.015, abs=1e-3)


def test_hysteresis_stiffens_a_small_motion_and_is_bounded_in_a_large_one() -> None:
    """Dahl's slope at rest is T/(strain length); far from where the motion turned the force is T."""
    small, large = 1e-8, 2e-3
    assert pulled(np.array([small]))[0] - 1000 == pytest.approx((SPRING + FORCE / (STRAIN * LENGTH)) * small, rel=1e-3)
    there = pulled(np.linspace(0, large, 2000))[-1]
    assert there - 1000 - SPRING * large == pytest.approx(FORCE, rel=1e-3)


def test_hysteresis_asks_for_strain_and_not_for_rope_that_is_paid_out() -> None:
    """At constant tension the stretch of a rope that gets longer grows, its strain does not: the friction stays."""
    strain, v = 1000 / (80e9 * 4.52e-4), 1.8
    # the vehicle moves away at v, and the drum pays out less than that by what the rope stretches
    ends = RopeEnds(-20.0, -v + v * strain, strain * LENGTH, v * strain, LENGTH, 1 / LENGTH)
    state = RopeState(hysteresis=Hysteresis(0.5))
    pull = rope_pull(ROPE, state, ends, Track(), density=1000.0, slack=True)
    assert pull.rate.hysteresis.share == pytest.approx(0.0, abs=1e-9)
    assert pull.at_drum == pytest.approx(1000 + 0.5 * FORCE)


def test_a_slack_rope_has_no_friction() -> None:
    ends = RopeEnds(-1e-3, 0.0, -1e-3, 0.0, LENGTH, 1 / LENGTH)
    for share in (-1.0, 1.0):
        pull = rope_pull(ROPE, RopeState(hysteresis=Hysteresis(share)), ends, Track(), density=1000.0, slack=True)
        assert pull.at_drum == pull.at_vehicle == 0.0
