"""The optimal preload: against formulas and a second solver, and below what controllers need."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.analysis.preload import OptimalPreload, optimal_preload
from dualwinch.codegen.errors import DualwinchError
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.tiers import mostly_slow

RADIUS, GEAR, INERTIA, LEAST, MOST = 0.8, 36.0, 1.8, 200.0, 6000.0
LEVER = RADIUS / GEAR
COARSE = 200
"""Samples in a step that divides all phases of the motion, where the default is five times as fine and as dear."""

SMOOTH = override(case(2), {"reference.jerk_limit": 0.05, "plant.vehicle.friction_coefficient": 0.0})


def motion(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Speed and acceleration of the paper's profile, and so of Case 2."""
    v = np.select([t <= 18, t <= 29, t <= 41], [0.1 * t, 1.8, 6.15 - 0.15 * t], 0.0)
    return v, np.select([t <= 18, t <= 29, t <= 41], [0.1, 0.0, -0.15], 0.0)


@pytest.mark.parametrize("least", ["load", "peak", "energy"])
def test_without_further_limits_the_rope_behind_is_at_its_least(least: Any) -> None:
    """So the least load is the least peak and the least energy, too. The drum that pays out asks for a little more."""
    found = optimal_preload(case(2), least, elastic=False, every=COARSE)
    v, a = motion(found.t)
    force = 1e4 * a + 490 * np.tanh(v / 0.01) + 900 * v * abs(v)
    turning = INERTIA * a / RADIUS**2
    F2 = np.maximum(LEAST + np.maximum(turning, 0), LEAST + np.maximum(-turning, 0) - force)
    F1 = F2 + force
    torques = LEVER * (F1 + turning), LEVER * (F2 - turning)
    inner = slice(1, -1)
    load = np.sqrt(np.mean([torque[inner] ** 2 for torque in torques]))
    speed = v[inner] / LEVER
    assert found.continuous_load == pytest.approx(load, rel=1e-6 if least == "load" else 1e-4)
    assert found.peak_tension == pytest.approx(F1.max(), rel=1e-6)
    work = 0.2 * np.sum((torques[0] + torques[1])[inner] * speed)
    assert found.energy == pytest.approx(work, rel=1e-6 if least != "peak" else 1e-4)
    if least == "load":
        assert found.F1[inner] == pytest.approx(F1[inner], rel=1e-4)


def test_a_second_solver_agrees_where_torques_may_not_jump() -> None:
    """A quadratic program of its own in the tension of rope 2, by PIQP."""
    every, rate = 100, 20.0
    found = optimal_preload(SMOOTH, torque_rate=rate, elastic=False, every=every)
    assert found.continuous_load > 1.001 * optimal_preload(SMOOTH, elastic=False, every=every).continuous_load
    run = simulate(SMOOTH)
    v, a = run["v_ref"][::every][1:-1], run["a_ref"][::every][1:-1]
    force, turning = 1e4 * a + 900 * v * abs(v), INERTIA * a / RADIUS**2
    offsets = np.concatenate([LEVER * (force + turning), -LEVER * turning])
    instants, step = len(v), every * 1e-3
    both = LEVER * np.vstack([np.eye(instants), np.eye(instants)])
    change = np.diff(np.eye(instants), axis=0)
    quadratic, linear = ca.sparsify(ca.DM(both.T @ both)), ca.sparsify(ca.DM(np.vstack([both, change, change])))
    known = np.diff(offsets.reshape(2, -1)).ravel() / LEVER
    tight = {"piqp": {"eps_abs": 1e-9, "eps_rel": 1e-10}}
    solver = ca.conic("second", "piqp", {"h": quadratic.sparsity(), "a": linear.sparsity()}, tight)
    F2 = solver(
        h=quadratic,
        g=both.T @ offsets,
        a=linear,
        lba=np.concatenate([LEVER * LEAST - offsets, -rate * step / LEVER - known]),
        uba=np.concatenate([LEVER * MOST - offsets, rate * step / LEVER - known]),
        lbx=np.maximum(LEAST, LEAST - force),
        ubx=np.minimum(MOST, MOST - force),
    )["x"]
    torques = both @ np.asarray(F2).ravel() + offsets
    assert found.continuous_load == pytest.approx(np.sqrt(np.mean(torques**2)), rel=1e-6)


def test_drums_take_up_what_ropes_stretch_by() -> None:
    soft = override(SMOOTH, {"plant.rope_1.modulus": 5e8, "plant.rope_2.modulus": 1e9})
    found = optimal_preload(soft, every=COARSE)
    x, _, a = (simulate(soft)[name][::COARSE] for name in ("x_ref", "v_ref", "a_ref"))
    for tension, torque, length, way, modulus in (
        (found.F1, found.tau_1, 50.5 - x, 1, 5e8),
        (found.F2, found.tau_2, x + 0.5, -1, 1e9),
    ):
        stretch = tension * length / (modulus * 4.52e-4)
        bend = (stretch[2:] - 2 * stretch[1:-1] + stretch[:-2]) / (1e-3 * COARSE) ** 2
        expected = LEVER * tension[1:-1] + INERTIA / RADIUS / GEAR * (way * a[1:-1] + bend)
        assert torque == pytest.approx(expected, rel=1e-9)


def test_ropes_of_steel_make_no_difference() -> None:
    stiff, rigid = (
        optimal_preload(case(4), elastic=elastic, every=COARSE).continuous_load for elastic in (True, False)
    )
    assert stiff == pytest.approx(rigid, rel=1e-5)


@pytest.mark.parametrize(
    ("least", "name"),
    mostly_slow(
        [("load", "continuous_load"), ("energy", "energy"), ("peak", "peak_tension")], lambda row: row[0] == "load"
    ),
)
def test_no_controller_needs_less(least: Any, name: str) -> None:
    """Whatever its preload, and with all of its error allowed."""
    for settings in (
        {"controller.coordination.preload": 401.0},
        {"controller.coordination.kind": "scheduled-preload", "controller.scheduled_preload.margin": 0.0},
    ):
        experiment = override(case(4), settings)
        run = simulate(experiment).metrics
        bound = optimal_preload(experiment, least, error=run.max_abs_error, every=100)
        assert getattr(bound, name) < run[name]


def test_ropes_with_mass_need_the_tensions_of_massless_ones() -> None:
    mass = {f"plant.rope_{number}.mass_per_length": 0.8 for number in (1, 2)}
    plain, heavy = (optimal_preload(override(case(4), values), every=500) for values in ({}, mass))
    assert heavy.continuous_load == pytest.approx(plain.continuous_load, rel=1e-6)


def test_an_error_that_is_allowed_is_used() -> None:
    exact, loose = (optimal_preload(case(4), "peak", error=error, every=COARSE) for error in (0.0, 0.02))
    assert abs(loose.e).max() == pytest.approx(0.02, rel=1e-6)
    assert loose.peak_tension < exact.peak_tension - 10


def test_a_motion_beyond_the_limits_is_said() -> None:
    weak = override(case(4), {"controller.coordination.tension_max": 4000.0})
    with pytest.raises(DualwinchError, match="no tensions within 200 to 4000 N give the motion to within 0 m"):
        optimal_preload(weak, every=COARSE)
    assert isinstance(optimal_preload(weak, error=2.0, every=COARSE), OptimalPreload)
