"""The linear closed loop against the nonlinear one."""

from dataclasses import replace

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.operating_points import loop_operating_point
from dualwinch.analysis.steady_motion import without_round_off
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.linear.modes import modes
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from tests.simulation.inserted import run
from tests.tiers import all_but, mostly_slow

PAPER = case(2)
SMOOTH = override(PAPER, {"controller.nftsm.smoothing": 0.05, "controller.observer.kf": 0.0})
"""Where a speed error of 1 mm/s is small: far below the smoothing, and the observer's gain fixed."""

LAWS = (
    {},
    {"controller.kind": "nftsm"},
    {"controller.kind": "pid-cascade"},
    {"controller.kind": "super-twisting"},
    {"controller.kind": "adrc"},
    {"controller.kind": "lqi"},
    {"controller.kind": "eid"},
    {"controller.kind": "rbf-sliding-mode"},
    {"controller.kind": "mpc"},
    {"controller.estimator": "kalman"},
    {"controller.coordination.kind": "force-position"},
    {"simulation.delay_samples": 2},
    {"controller.nominal.mass": 9e3, "controller.nominal.drag_coefficient": 0.25},
)

QUICK = (LAWS[0], LAWS[2], LAWS[6], LAWS[-1], LAWS[-2], LAWS[-3])


SITE = replace(SMOOTH, plant=load_ensemble("site").experiment.plant)
"""On heavy winches and ropes, with drums damped as by the ropes' wave impedance; sag, gearboxes, rollers."""
SITE = override(SITE, {f"controller.winch_{number}.damping": 164.0 for number in (1, 2)})


@pytest.mark.parametrize(
    ("experiment", "v", "kick"),
    [(SMOOTH, 0.0, 1e-3), (SMOOTH, 0.5, 1e-3), (SMOOTH, 1.8, 1e-3), (SITE, 0.5, 1e-4)],
    ids=["at rest", "slow", "fast", "site"],
)
def test_response_to_a_small_kick_is_that_of_the_nonlinear_loop(experiment: Experiment, v: float, kick: float) -> None:
    system = linear_closed_loop(experiment, 25.0, v)
    kicked = run(experiment, 25.0, v, {"motion.plant.v": kick}, 600)
    steady = run(experiment, 25.0, v, {}, 600)
    deviation = np.zeros(len(system.states))
    deviation[system.states.index("v")] = kick
    predicted = []
    for _ in range(600):
        predicted.append(system.C @ deviation)
        deviation = system.A @ deviation
    for name in ("x", "v", "F1", "F2"):
        linear = np.array(predicted)[:, system.outputs.index(name)]
        nonlinear = kicked[name] - steady[name]
        assert np.abs(linear - nonlinear).max() < 0.01 * np.abs(nonlinear).max(), name


@pytest.mark.parametrize("changes", mostly_slow(((law,) for law in LAWS), lambda row: row[0] in QUICK), ids=str)
def test_matrices_are_the_steps_own_for_every_law(changes: dict[str, object]) -> None:
    """Against central differences of the step that is simulated, ropes that may go slack included."""
    experiment = override(PAPER, changes)
    cruise, system = loop_operating_point(experiment, 20.0, 0.5), linear_closed_loop(experiment, 20.0, 0.5)
    step = closed_loop(structure_of(cruise.experiment)).step

    def following(state: np.ndarray) -> np.ndarray:
        return np.array(step(state, cruise.exogenous, cruise.parameters)[0]).ravel()

    kept = [cruise.loop.states.index(f"motion.plant.{name}") for name in system.states if name in {"v", "omega_1"}]
    for place in kept:
        size = 1e-7
        state = np.zeros(len(cruise.state))
        state[place] = size
        slope = (following(cruise.state + state) - following(cruise.state - state)) / (2 * size)
        column = system.states.index(cruise.loop.states[place].removeprefix("motion.plant."))
        for name in ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2"):
            found = slope[cruise.loop.states.index(f"motion.plant.{name}")]
            exact = system.A[system.states.index(name), column]
            assert found == pytest.approx(exact, rel=1e-4, abs=1e-6)


def test_the_papers_loop_is_stable_and_its_states_are_those_that_matter() -> None:
    system = linear_closed_loop(PAPER, 25.0, 0.5)
    assert np.abs(system.poles()).max() < 1
    assert {"x", "v", "theta_1", "omega_1", "nftsm.Z_a", "observer.d_hat", "winch_1.integral"} <= set(system.states)
    assert not [name for name in system.states if "primed" in name or "metrics" in name or "encoder" in name]
    assert system.units["winch_1.integral"] == "N s"
    assert system.dt == PAPER.simulation.sample_time


def test_closing_the_cut_loop_gives_the_closed_loop() -> None:
    for opening in ("u", "tau_1", "tau_2"):
        whole, opened = linear_closed_loop(PAPER, 25.0, 0.5), linear_open_loop(PAPER, 25.0, 0.5, opening)
        closed = np.linalg.eigvals(opened.A - opened.B @ opened.C)
        for pole in whole.poles():
            assert np.abs(closed - pole).min() < 1e-5


def test_position_follows_its_reference_and_a_winch_at_its_limit_holds_its_torque() -> None:
    slow, fast = (linear_closed_loop(PAPER, 25.0, v) for v in (0.5, 1.8))
    gain = slow.C @ np.linalg.solve(np.eye(len(slow.states)) - slow.A, slow.B) + slow.D
    assert gain[slow.outputs.index("x"), slow.inputs.index("x_ref")] == pytest.approx(1)
    assert not fast.C[fast.outputs.index("tau_2")].any()
    assert slow.C[slow.outputs.index("tau_2")].any()


@pytest.mark.parametrize("estimator", ["none", "calibrating-kalman"])
def test_states_are_the_same_wherever_the_vehicle_is(estimator: str) -> None:
    """What moves the rest by round-off alone here, and not at all there, is no state: what an estimator knows of."""
    experiment = override(PAPER, {"controller.estimator": estimator})
    (states,) = {linear_closed_loop(experiment, x, v).states for x in (5.0, 25.0, 45.0) for v in (0.0, 0.5)}
    assert not [name for name in states if name.endswith(("information", "filtered"))]


@pytest.mark.parametrize("kind", ["adrc", "eid"])
def test_a_laws_own_position_and_speed_are_not_called_as_the_vehicles(kind: str) -> None:
    loop = linear_closed_loop(override(PAPER, {"controller.kind": kind}), 25.0, 0.5)
    assert len(set(loop.states)) == len(loop.states)
    assert {"x", "v", "law.x", "law.v", "winch_1.integral"} <= set(loop.states)
    assert [sum(mode.participation.values()) for mode in modes(loop)] == pytest.approx([1.0] * len(modes(loop)))


def test_each_gearbox_has_its_own_mode_where_only_one_winch_is_free() -> None:
    """At 1 m/s winch 2 rests on its limit, and what its gearbox does shakes the other one by the controller."""
    site = load_ensemble("site").experiment
    found = {mode.label: mode for mode in modes(linear_closed_loop(site, 25.0, 1.0), site.plant)}
    for number in (1, 2):
        first, second, *_ = found[f"gearbox {number}"].main_states
        assert {first, second} == {f"motor_{number}.theta", f"motor_{number}.omega"}
    soft = override(site, {"plant.winch_1.gear_stiffness": 1e6})
    found = {mode.label: mode for mode in modes(linear_closed_loop(soft, 25.0, 1.0), soft.plant)}
    assert {*found["gearbox 1"].main_states[:2]} == {"motor_1.theta", "motor_1.omega"}
    assert {*found["sag of rope 2"].main_states[:2]} == {"rope_2.sag.depth", "rope_2.sag.rate"}


def test_derivatives_that_are_round_off_are_zero_in_any_unit() -> None:
    here, above, below = (
        np.array([1e-26, 2.0, 0.0, 3e-40]),
        np.array([1e-9, 2.1, 5.0, 1e-33]),
        np.array([-1e-9, 2, 0, 1]),
    )
    for unit in (1.0, 1e30, 1e-30):
        assert (without_round_off(unit * here, unit * above, unit * below) != 0).tolist() == [False, True, False, False]


def test_an_experiment_is_linearised_amid_its_own_track() -> None:
    long = override(case(2), {"plant.track.length": 120.0, "plant.vehicle.mass": 3e3})
    system = dw.linearise(long, v=0.5)
    assert system.operating_point["x"] == 60
    assert system.A.tolist() == dw.linearise(long, 60.0, 0.5).A.tolist()


def test_slopes_of_any_size_are_told_from_round_off_without_overflow() -> None:
    """Their product would overflow; warnings are errors here."""
    slopes = np.array([1e200, 1e-200])
    assert (without_round_off(slopes, slopes * [1.1, -1.0], slopes * [0.9, 1.0]) != 0).tolist() == [True, False]


OFF = {"plant.winch_1.radius_error": 1e-3, "plant.winch_2.radius_error": -5e-4, "plant.rope_1.modulus": 72e9}
"""Drums and a rope that differ from those the controller assumes; 1 mm/m is 3 cm at 29 m."""


@pytest.mark.slow
def test_what_a_filter_has_learnt_is_constant_for_fast_motions() -> None:
    """A push, after a minute in which the filter has learnt the machine: with it, less without it, as linearised."""
    began, push, v, samples = 60.0, 5.0, 0.5, 600
    way = {
        "reference.kind": "way-points",
        "reference.points": [45.0],
        "reference.speed": v,
        "disturbance.vortex": False,
    }
    experiment = override(SMOOTH, OFF | way | {"controller.estimator": "self-calibrating-kalman"})
    experiment = override(experiment, {"simulation.duration": began + 2, "disturbance.vortex": False})
    force = dw.Signal.from_arrays([0.0, began], [0.0, push], unit="N", interpolation="previous")
    calm = dw.simulate(experiment)
    pushed = dw.simulate(replace(experiment, disturbance=replace(experiment.disturbance, force=force)))
    first = round(began / experiment.simulation.sample_time)
    assert calm["scale_1"][first] == pytest.approx(OFF["plant.winch_1.radius_error"], rel=1e-4)
    system = linear_closed_loop(experiment, calm["x"][first], v)
    assert not [name for name in system.states if name.endswith(("information", "estimate", "excess", "error"))]
    inputs, deviation, predicted = np.zeros(len(system.inputs)), np.zeros(len(system.states)), []
    inputs[system.inputs.index("force")] = push
    for _ in range(samples):
        predicted.append(system.C @ deviation + system.D @ inputs)
        deviation = system.A @ deviation + system.B @ inputs
    for name in ("x", "v", "F1", "F2"):
        linear = np.array(predicted)[:, system.outputs.index(name)]
        nonlinear = (pushed[name] - calm[name])[first : first + samples]
        assert np.abs(linear - nonlinear).max() < 1e-3 * np.abs(nonlinear).max(), name


@pytest.mark.parametrize("v", all_but([0.5], [0.0, 0.5, -1.2]))
def test_a_filter_knows_a_machine_that_differs_from_its_data_sheet(v: float) -> None:
    """At every point as after a run there: no error, no reading refused and no encoder suspect."""
    point = loop_operating_point(override(SMOOTH, OFF | {"controller.estimator": "self-calibrating-kalman"}), 40.0, v)
    assert point.row["e"] == pytest.approx(0, abs=1e-5)
    assert point.row["x_est"] == pytest.approx(40.0, abs=1e-6)
    assert (point.row["fault_1"], point.row["fault_2"], point.row["position_used"]) == (0.0, 0.0, 1.0)
    states = dict(zip(point.loop.states, point.state.tolist(), strict=True))
    assert states["controller.estimator.encoder_1.tare"] == pytest.approx(-0.04, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("v", [0.0, 0.5])
def test_a_filter_that_learns_the_scale_of_the_speed_wheel_leaves_the_loop_as_it_is(v: float) -> None:
    """The scale of an exact wheel is learnt as zero; at rest nothing is learnt of it."""
    without = override(SMOOTH, {"controller.estimator": "self-calibrating-kalman"})
    point = loop_operating_point(override(without, {"controller.drums.wheel": 0.002}), 25.0, v)
    state = dict(zip(point.loop.states, point.state.tolist(), strict=True))
    assert state["controller.estimator.wheel.error"] == pytest.approx(0, abs=1e-9)
    assert state["controller.estimator.wheel.rolled"] == pytest.approx(v * 2.0, abs=1e-9)
    fast = [
        np.sort_complex(poles[np.abs(poles) < 0.999])
        for wheel in (0.0, 0.002)
        if (poles := linear_closed_loop(override(without, {"controller.drums.wheel": wheel}), 25.0, v).poles()).size
    ]
    assert fast[1].size >= fast[0].size
    assert np.abs(fast[0][:, None] - fast[1][None, :]).min(axis=1).max() < 1e-3
