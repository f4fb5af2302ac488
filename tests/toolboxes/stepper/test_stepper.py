import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dualwinch as dw
from dualwinch.config.ensemble_file import reset
from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.simulation.results.result import Result
from dualwinch.toolboxes.stepper.stepper import SENSED, Stepper
from tests.lasting import lasting
from tests.own_parts import DriftFree, StateFeedback, Watched
from tests.toolboxes.stepper.feeding import PLANT, feed, torques_of

NOISY = {
    "sensors.position_noise": 1e-3,
    "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 5.0,
    "sensors.encoder_counts": 4096,
    "disturbance.current_sigma": 0.05,
    "disturbance.normal_force_sigma": 0.1,
    "simulation.seed": 3,
}
GUST = dw.Signal.from_arrays([0.0, 0.2, 0.4], [0.0, 300.0, -100.0], unit="N")


def short(number: int = 4, controller: str = "fando-nftsm", duration: float = 0.6, **keys: Any) -> dw.Experiment:
    return dw.override(dw.case(number, controller), {"simulation.duration": duration} | keys)


def assert_same_plant(ours: Result, theirs: Result) -> None:
    for name in (*PLANT, "d_true", "tau_1", "tau_2"):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    common = ours.final_state.keys() & theirs.final_state.keys() - {"metrics.saturated"}
    assert {"motion.plant.x", "motion.slow", "metrics.work", "sample"} <= common
    assert {name: ours.final_state[name] for name in common} == {name: theirs.final_state[name] for name in common}
    assert (ours.outcome, ours.end_time) == (theirs.outcome, theirs.end_time)


@pytest.mark.parametrize(
    "experiment",
    [
        short(1),
        dw.override(short(2, "pid-cascade"), {"simulation.integrator": "rk4"}),
        short(3, "nftsm", **{"simulation.delay_samples": 3}),
        short(4, **{"plant.rope_slack": False, "simulation.sample_time": 2e-3}),
        short(4, **NOISY),
        replace(short(4, **NOISY), disturbance=replace(short(4, **NOISY).disturbance, force=GUST)),
        reset(lasting(0.6, "rig"), {"sensors.outage_period": 0.5}).scenario(2, 7).experiment,
    ],
    ids=["slack", "rk4", "delay", "two-sided rope", "noise", "signal", "rig"],
)
def test_a_lane_fed_with_the_torques_of_a_run_is_that_run_to_the_bit(experiment: dw.Experiment) -> None:
    run = dw.simulate(experiment, engine="interpreter")
    stepper = Stepper(experiment, batch=2, exact=True)
    feed(stepper, torques_of(run))
    for lane in (0, 1):
        assert_same_plant(stepper.result(lane), run)
    own = stepper.result(0)
    np.testing.assert_array_equal(
        [values[0] for values in stepper.metrics.values()], list(vars(own.metrics).values()), strict=True
    )
    both = {name for name, value in vars(run.metrics).items() if value == getattr(own.metrics, name)}
    assert vars(run.metrics).keys() - both <= {"saturated_share", "steady_mae", "steady_mse", "steady_max_abs_error"}
    assert list(stepper.outcomes) == ["completed"] * 2


@pytest.mark.parametrize("exact", [True, False])
def test_the_compiled_run_differs_by_rounding_alone(exact: bool) -> None:
    experiment = short(1, duration=2.0)
    run = dw.simulate(experiment)
    stepper = Stepper(experiment, batch=2, exact=exact)
    feed(stepper, torques_of(run))
    own = stepper.result(1)
    for name in PLANT:
        np.testing.assert_allclose(own[name], run[name], rtol=0, atol=1e-8 * max(1, abs(run[name]).max()), err_msg=name)


def test_lane_k_is_scenario_k_of_the_seed() -> None:
    ensemble, lanes = lasting(0.3), (0, 2)
    runs = {}
    for lane in lanes:
        scenario = ensemble.scenario(lane, 7)
        runs[lane] = dw.simulate(scenario.experiment, nominal=scenario.nominal, engine="interpreter")
    commands = np.zeros((300, 3, 2))
    for lane in lanes:
        commands[:, lane] = torques_of(runs[lane])
    stepper = Stepper(ensemble, batch=3, seed=7, exact=True)
    for command in commands:
        stepper.step(command)
    for lane in lanes:
        assert_same_plant(stepper.result(lane), runs[lane])
        assert stepper.scenarios[lane].draws == ensemble.scenario(lane, 7).draws
    assert stepper.result(0).nominal == ensemble.experiment.plant


@pytest.mark.parametrize("exact", [True, False])
@given(data=st.data())
@settings(max_examples=12, deadline=None)
def test_a_lane_depends_on_its_own_commands_alone(exact: bool, data: st.DataObject) -> None:
    """Its bits are the same in whatever batch, at whatever number, whatever the neighbours get."""
    batch = data.draw(st.integers(1, 35))
    lane = data.draw(st.integers(0, batch - 1))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    commands = rng.uniform(5, 130, (30, batch, 2))
    experiment = short(4, **NOISY)
    together, alone = (Stepper(experiment, batch=count, exact=exact) for count in (batch, 1))
    for command in commands:
        ours, own = together.step(command), alone.step(command[lane : lane + 1])
        np.testing.assert_array_equal(ours.array[:, lane], own.array[:, 0])
    assert together.result(lane) == alone.result(0)


def test_the_observation_is_what_a_controller_gets() -> None:
    experiment = short(4, **NOISY)
    stepper = Stepper(experiment, batch=2)
    commands = torques_of(dw.simulate(experiment))[:50]
    gathered, observation = [stepper.observation["x_sensed"]], stepper.observation
    for command in commands:
        observation = stepper.step(np.broadcast_to(command, (2, 2)))
        gathered.append(observation["x_sensed"])
    run = stepper.result(0)
    np.testing.assert_array_equal(np.array(gathered)[:50, 0], run["x_sensed"])
    assert abs(run["x_sensed"] - run["x"]).max() > 1e-4  # the noise of the sensor
    assert tuple(observation) == SENSED == tuple(observation.units)
    assert observation.units["F1_sensed"] == "N"
    assert len(observation) == len(SENSED)
    assert observation["t"].tolist() == stepper.times.tolist() == [pytest.approx(0.05)] * 2
    with pytest.raises(UnknownNameError, match="did you mean 'x_sensed'"):
        observation["x_sense"]


def test_what_is_observed_last_belongs_to_the_end_of_the_run() -> None:
    """The reference after the last sample, for which the run itself has no row."""
    experiment = short(1, duration=0.01)
    stepper = Stepper(experiment, batch=1)
    for _ in range(10):
        stepper.step([[22.0, 22.0]])
    observation = stepper.observation
    assert observation["t"][0] == pytest.approx(0.01)
    assert observation["x_ref"][0] == pytest.approx(1.5 * 0.01)


def test_any_column_may_be_observed() -> None:
    stepper = Stepper(short(), batch=2, signals=["e", "F1", "tau_2"])
    observation = stepper.step([[20.0, 21.0], [22.0, 23.0]])
    assert observation["tau_2"].tolist() == [21.0, 23.0]
    assert observation.units == {"e": "m", "F1": "N", "tau_2": "N m"}


@pytest.mark.parametrize("exact", [True, False])
def test_a_force_goes_through_the_coordination_of_the_experiment(exact: bool) -> None:
    experiment = short(4, duration=1.0)
    run = dw.simulate(experiment, engine="interpreter")
    stepper = Stepper(experiment, batch=3, command="force", exact=exact)
    feed(stepper, run["u"])
    own = stepper.result(1)
    for name in (*PLANT, "u", "u_sat", "F1_cmd", "F2_cmd", "tau_1", "tau_2"):
        np.testing.assert_allclose(own[name], run[name], rtol=0, atol=1e-9 * max(1, abs(run[name]).max()), err_msg=name)
    assert own.metrics.saturated_share == run.metrics.saturated_share


def test_parts_of_a_users_own_stay_in_the_loop() -> None:
    """Estimator and coordination, their signals too."""
    controller = dw.Controller(law=StateFeedback(), estimator=DriftFree(), coordination=Watched())
    experiment = replace(short(4, **NOISY), controller=controller)
    run = dw.simulate(experiment, engine="interpreter")
    stepper = Stepper(experiment, batch=2, command="force", signals=["imbalance", "x_sensed"], exact=True)
    feed(stepper, run["u"])
    own = stepper.result(0)
    for name in ("x", "F1", "tau_2", "offset", "imbalance"):
        np.testing.assert_allclose(own[name], run[name], rtol=1e-9, atol=1e-9, err_msg=name)
    assert "surprise" not in own  # a signal of the law


def test_a_force_beyond_the_limit_is_limited() -> None:
    stepper = Stepper(short(), batch=1, command="force")
    stepper.step([1e5])
    run = stepper.result(0)
    assert (run["u"][0], run["u_sat"][0]) == (1e5, stepper.experiment.controller.limits.force)


def test_torques_are_taken_as_they_are() -> None:
    stepper = Stepper(short(), batch=1)
    stepper.step([[-7.0, 500.0]])
    run = stepper.result(0)
    assert (run["tau_1"][0], run["tau_2"][0]) == (-7.0, 500.0)
    plant = stepper.experiment.plant
    assert run["F2_cmd"][0] == pytest.approx(500.0 * plant.winch_2.gear_ratio / plant.winch_2.drum_radius)
    assert run["u"][0] == pytest.approx(run["F1_cmd"][0] - run["F2_cmd"][0])


@pytest.mark.parametrize("exact", [True, False])
def test_a_held_command_is_that_command_again_and_again(exact: bool) -> None:
    experiment = short(4, **NOISY, duration=0.25)
    slow, fast = Stepper(experiment, batch=2, hold=7, exact=exact), Stepper(experiment, batch=2, exact=exact)
    rng = np.random.default_rng(1)
    while slow.running.any():  # 250 samples are no multiple of 7: the last step is shorter
        command = rng.uniform(5, 60, (2, 2))
        held = slow.step(command)
        for _ in range(min(7, 250 - int(fast.samples[0]))):
            fast.step(command)
        np.testing.assert_array_equal(held.array, fast.observation.array)
    assert slow.samples.tolist() == fast.samples.tolist() == [250, 250]
    assert slow.result(1) == fast.result(1)


@pytest.mark.parametrize("exact", [True, False])
def test_lanes_that_end_stay_as_they_are(exact: bool) -> None:
    experiment = dw.case(2)
    stepper = Stepper(experiment, batch=3, hold=10, exact=exact, signals=["x", "v"])
    commands = np.array([[22.0, 22.0], [4.0, 130.0], [22.0, 22.0]])  # the second is pulled off the track
    while stepper.running.all():
        stepper.step(commands)
    ended, observed = stepper.result(1), stepper.observation.array[:, 1].copy()
    assert stepper.outcomes.tolist() == ["running", "left_track", "running"]
    assert observed[0] < -experiment.plant.track.rope_offset / 2
    commands[1] = np.nan  # whoever commands a lane that has ended may have nothing to say
    for _ in range(50):
        stepper.step(commands)
    np.testing.assert_array_equal(stepper.observation.array[:, 1], observed)
    assert stepper.result(1) == ended
    assert ended.end_time == stepper.times[1]
    assert stepper.times[1] < stepper.times[0]
    assert np.isnan(ended.metrics.mse)
    assert ended.final_state["motion.plant.x"] == observed[0]


@pytest.mark.parametrize("exact", [True, False])
def test_a_lane_that_diverges_shows_what_was_last_finite(exact: bool) -> None:
    stepper = Stepper(short(), batch=2, exact=exact)
    stepper.step([[22.0, 22.0], [22.0, 22.0]])
    before = stepper.observation.array[:, 0].copy()
    stepper.step([[1e308, -1e308], [22.0, 22.0]])
    assert stepper.outcomes.tolist() == ["diverged", "running"]
    np.testing.assert_array_equal(stepper.observation.array[:, 0], before)
    assert np.isfinite(stepper.step([[np.inf, 0.0], [22.0, 22.0]]).array).all()
    assert stepper.result(0).outcome == "diverged"
    assert stepper.result(0).end_time == pytest.approx(2e-3)


def test_a_fork_goes_on_by_itself() -> None:
    stepper = Stepper(lasting(0.6), batch=4, hold=5)
    rng = np.random.default_rng(2)
    for _ in range(20):
        stepper.step(rng.uniform(5, 60, (4, 2)))
    fork, before = stepper.fork(), stepper.observation.array
    commands = rng.uniform(5, 60, (40, 4, 2))
    ahead = [fork.step(command).array for command in commands]
    np.testing.assert_array_equal(stepper.observation.array, before)
    again = [stepper.step(command).array for command in commands]
    np.testing.assert_array_equal(ahead, again)
    assert fork.result(3) == stepper.result(3)
    np.testing.assert_array_equal(copy.deepcopy(stepper).observation.array, stepper.observation.array)


@pytest.mark.parametrize("exact", [True, False])
def test_one_lane_may_be_tried_in_many_ways(exact: bool) -> None:
    stepper = Stepper(lasting(0.6), batch=20, exact=exact)
    rng = np.random.default_rng(3)
    for _ in range(30):
        stepper.step(rng.uniform(5, 60, (20, 2)))
    fork = stepper.fork(np.repeat([17, 3], 9))
    assert (fork.batch, [scenario.index for scenario in fork.scenarios]) == (18, [17] * 9 + [3] * 9)
    ways = rng.uniform(5, 60, (18, 2))
    commands = rng.uniform(5, 60, (20, 2))
    commands[3] = ways[12]
    for _ in range(5):  # the sea's torques are a sample late
        fork.step(ways)
        stepper.step(commands)
    ours, theirs = fork.observation, stepper.observation
    assert np.unique(ours["F1_sensed"]).size == 18
    np.testing.assert_array_equal(theirs.array[:, 3], ours.array[:, 12])
    assert fork.result(12) == stepper.result(3)


@pytest.mark.parametrize("exact", [True, False])
def test_some_lanes_may_be_started_anew(exact: bool) -> None:
    ensemble = lasting(0.05)
    stepper = Stepper(ensemble, batch=18, seed=5, exact=exact)
    rng = np.random.default_rng(4)
    commands = rng.uniform(5, 60, (40, 18, 2))
    for command in commands[:20]:
        stepper.step(command)
    untouched = stepper.observation.array[:, 4].copy()
    stepper.reset(lanes=[3, 17], scenarios=[30, ensemble.scenario(31, 9)])
    np.testing.assert_array_equal(stepper.observation.array[:, 4], untouched)
    for command in commands[20:]:
        stepper.step(command)
    assert stepper.samples[[2, 3, 4, 17]].tolist() == [40, 20, 40, 20]
    other = Stepper(ensemble, batch=1, seed=5, exact=exact)
    other.reset(scenarios=[30])
    for command in commands[20:]:
        other.step(command[3:4])
    assert stepper.result(3) == other.result(0)
    assert stepper.result(17).experiment.plant == ensemble.scenario(31, 9).experiment.plant
    whole = Stepper(ensemble, batch=18, seed=5, exact=exact)
    for command in commands:
        whole.step(command)
    assert stepper.result(4) == whole.result(4)


def test_signals_are_drawn_as_they_are_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """However short their pages, they are those of the run."""
    monkeypatch.setattr("dualwinch.simulation.stepped_lanes.SHORTEST", 7)
    monkeypatch.setattr("dualwinch.simulation.stepped_lanes.PAGE_ROOM", 1)
    ensemble = lasting(0.1)
    stepper = Stepper(ensemble, batch=3, hold=5)
    forks = []
    for number in range(20):
        stepper.step(np.full((3, 2), 20.0 + number))
        forks.append(stepper.fork())
    monkeypatch.undo()
    whole = Stepper(ensemble, batch=3, hold=5)
    for number in range(20):
        whole.step(np.full((3, 2), 20.0 + number))
        np.testing.assert_array_equal(forks[number].observation.array, whole.observation.array)
    for number in range(5, 20):  # one that stayed behind reads on where the others have been
        forks[4].step(np.full((3, 2), 20.0 + number))
    assert forks[4].result(2) == whole.result(2) == stepper.result(2)


def test_threads_change_nothing() -> None:
    ours, theirs = (Stepper(short(**NOISY), batch=50, threads=threads, exact=False) for threads in (1, 3))
    rng = np.random.default_rng(5)
    for _ in range(20):
        command = rng.uniform(5, 60, (50, 2))
        np.testing.assert_array_equal(ours.step(command).array, theirs.step(command).array)


def test_a_run_under_way_is_a_result_without_figures_of_merit() -> None:
    stepper = Stepper(short(), batch=1)
    assert stepper.result(0)["x"].size == 0
    feed(stepper, np.full((10, 2), 22.0))
    run = stepper.result(0, stride=4)
    assert (run.outcome, run.end_time, run["t"].tolist()) == ("running", 0.01, [0.0, 0.004, 0.008])
    assert np.isnan(run.metrics.mse)
    assert run.nominal is None
    assert "given torques" in repr(run)
    assert stepper.result(0, stride=0)["x"].size == 0


def test_a_result_can_be_kept(tmp_path: object) -> None:
    stepper = Stepper(short(), batch=1, command="force")
    feed(stepper, np.full(600, 100.0))
    run = stepper.result(0)
    dw.save(run, f"{tmp_path}/run.parquet")
    assert dw.load_result(f"{tmp_path}/run.parquet", base=stepper.experiment) == run


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        (np.zeros(2), r"torques: shape \(2,\) must be \(2, 2\): motor torques tau_1, tau_2 in N m for each lane"),
        (np.zeros((3, 2)), r"torques: shape \(3, 2\) must be \(2, 2\)"),
        ([[1.0, 2.0], [np.nan, 3.0]], r"torques\[1, 0\] = nan: must be finite"),
        ([[1.0, np.inf], [2.0, 3.0]], r"torques\[0, 1\] = inf: must be finite"),
        ([["a", "b"], ["c", "d"]], r"torques: must be numbers"),
        ([[1.0], [1.0, 2.0]], r"torques: must be numbers"),
    ],
)
def test_commands_that_are_none_change_nothing(commands: object, message: str) -> None:
    stepper = Stepper(short(), batch=2)
    before = stepper.observation.array
    with pytest.raises(ConfigurationError, match=message):
        stepper.step(commands)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(stepper.observation.array, before)
    assert stepper.samples.tolist() == [0, 0]
    feed(stepper, np.full((3, 2), 22.0))
    assert stepper.result(0)["tau_1"].tolist() == [22.0] * 3  # nothing of them was recorded


def test_a_step_beyond_the_end_says_what_to_do() -> None:
    stepper = Stepper(short(duration=0.01), batch=2, hold=10)
    stepper.step(np.full((2, 2), 22.0))
    with pytest.raises(ConfigurationError, match=r"step: all lanes have ended; reset\(\) restarts them"):
        stepper.step(np.full((2, 2), 22.0))
    stepper.reset()
    stepper.step(np.full((2, 2), 22.0))


COARSE = {"simulation.sample_time": 0.05, "simulation.integrator": "exponential"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"batch": 0}, "batch = 0: must be a whole number >= 1"),
        ({"batch": 2.5}, "batch = 2.5: must be a whole number >= 1"),
        ({"seed": -1}, "seed = -1: must be a whole number >= 0"),
        ({"hold": True}, "hold = true: must be a whole number >= 1"),
        ({"threads": 0}, "threads = 0: must be a whole number >= 1"),
        ({"command": "torque"}, 'command = "torque": must be "torques" or "force"'),
        ({"signals": ["x_sense"]}, r"signals: unknown column 'x_sense'; did you mean 'x_sensed'\?"),
        ({"experiment": "sea"}, "experiment: must be an Experiment or an Ensemble, not str"),
        ({"experiment": dw.override(short(), COARSE)}, r"simulation\.substeps"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Stepper(**{"experiment": short(), "batch": 1} | arguments)


def test_a_draw_that_needs_more_sub_steps_than_the_loop_has_is_refused() -> None:
    heavy = dw.override(short(), {f"plant.rope_{number}.mass_per_length": 2.36 for number in (1, 2)})
    stiffer = dw.Drawn(dw.Uniform(1e3, 2e3), relative=True)
    ensemble = dw.Ensemble("", "", heavy, {"plant.rope_1.modulus": stiffer})
    with pytest.raises(ConfigurationError, match=r"^simulation\.substeps = 5: must be >= "):
        Stepper(ensemble, batch=2)


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("reset", {"lanes": [0, 2]}, "lanes: there is no lane 2: must be 0 to 1"),
        ("reset", {"lanes": [-1]}, "lanes: there is no lane -1"),
        ("reset", {"lanes": [True, False, True]}, "lanes: must be numbers of lanes, or 2 truth values"),
        ("reset", {"lanes": [0.5]}, "lanes: must be numbers of lanes"),
        ("reset", {"lanes": [0], "scenarios": [1, 2]}, "scenarios: has 2 numbers: must have 1, one a lane"),
        ("reset", {"lanes": [0], "scenarios": [-1]}, "scenarios: must be whole numbers >= 0, or scenarios, not -1"),
        ("reset", {"seed": -3}, "seed = -3: must be a whole number >= 0"),
        ("fork", {"lanes": []}, "lanes: must be one or more"),
        ("result", {"lane": 0}, "result: commands were not recorded"),
        ("step", {"commands": [0.0, np.nan]}, r"force\[1\] = nan: must be finite"),
        ("step", {"commands": np.zeros((3, 1))}, r"force: shape \(3, 1\) must be \(2,\): a force in N for each lane"),
    ],
)
def test_wrong_calls_are_named(method: str, arguments: dict[str, Any], message: str) -> None:
    stepper = Stepper(short(), batch=2, command="force", record=False)
    with pytest.raises(ConfigurationError, match=message):
        getattr(stepper, method)(**arguments)


def test_other_processes_give_the_same_bits() -> None:
    program = (
        "import numpy as np; from tests.toolboxes.stepper.test_stepper import Stepper, lasting\n"
        "stepper = Stepper(lasting(0.02), batch=3, seed=4)\n"
        "for _ in range(20): observation = stepper.step(np.full((3, 2), 25.0))\n"
        "print(observation.array.tobytes().hex())"
    )
    stepper = Stepper(lasting(0.02), batch=3, seed=4)
    for _ in range(20):
        stepper.step(np.full((3, 2), 25.0))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == stepper.observation.array.tobytes().hex()


def pickled(stepper: Stepper) -> Stepper:
    return pickle.loads(pickle.dumps(stepper))  # noqa: S301


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, pickled])
def test_a_copy_and_what_is_unpickled_go_on_by_themselves(duplicate: Callable[[Stepper], Stepper]) -> None:
    stepper = Stepper(dw.load_ensemble("sea"), 2, hold=20, command="force")
    for _ in range(20):
        stepper.step([10.0, -10.0])
    stepper.reset(lanes=[1], scenarios=[5])
    stepper.step([10.0, -10.0])
    other = duplicate(stepper)
    assert other.step([10.0, -10.0]).array.tolist() == stepper.step([10.0, -10.0]).array.tolist()
    other.step([0.0, 0.0])
    assert (stepper.times.tolist(), other.times.tolist()) == ([0.44, 0.04], [0.46, 0.06])
    assert other.result(1).columns["x"][:40].tolist() == stepper.result(1).columns["x"].tolist()
