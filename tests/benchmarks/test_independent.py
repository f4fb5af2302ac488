"""The independent machine: goes where the product says while nothing is drawn, and says what it cannot run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.independent.__main__ import judged
from benchmarks.independent.identified import gains_of
from benchmarks.independent.judge import LOGGED, SAMPLES, Conditions, Judge, Runs
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

CALM = {
    "disturbance.current_sigma": 0.0,
    "disturbance.normal_force_sigma": 0.0,
    "sensors.position_noise": 0.0,
    "sensors.position_resolution": 0.0,
    "sensors.speed_noise": 0.0,
    "sensors.tension_noise": 0.0,
    "sensors.encoder_counts": 0,
    "simulation.integrator": "rk4",
    "simulation.substeps": 64,
}


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    return Judge(Experiment(controller=paper_controller()), tmp_path_factory.mktemp("paper"))


def test_in_a_calm_sea_it_goes_where_simulate_says(paper: Judge) -> None:
    sea = replace(load_ensemble("sea").experiment, controller=paper_controller())
    theirs = simulate(override(sea, CALM)).metrics
    ours = paper.run(Conditions(spread=0, imperfect=0, noisy=False, outage_length=0), [1])
    assert ours.clean.all()
    assert ours.mse == pytest.approx(theirs.mse, rel=1e-6)
    assert ours.largest_error == pytest.approx(theirs.max_abs_error, rel=1e-6)
    assert ours.peak_tension == pytest.approx(theirs.peak_tension, rel=1e-6)
    assert ours.min_tension == pytest.approx(theirs.min_tension, rel=1e-6)
    assert ours.chatter == pytest.approx(theirs.chatter, rel=1e-5)


OVERLOADS = {
    "disturbance.push.force": -4e3,
    "disturbance.push.start": 10.0,
    "disturbance.payload.mass": 0.1,
    "disturbance.payload.drag": 0.1,
    "disturbance.dropout_2.share": 1.0,
    "disturbance.dropout_2.start": 35.0,
    "actuator.kind": "motor",
    "actuator.motor.time_constant": 1e-7,
    "actuator.motor.torque_limit": 120.0,
    "actuator.motor.base_speed": 75.0,
}


def test_overloads_throw_it_off_as_they_do_in_the_product(paper: Judge) -> None:
    sea = replace(load_ensemble("sea").experiment, controller=paper_controller())
    theirs = simulate(override(sea, CALM | OVERLOADS)).metrics
    effects = {"push_force": 4e3, "push_start": 10.0, "payload_mass": 0.1, "payload_drag": 0.1}
    effects |= {"dropout_start_2": 35.0, "dropout_length_2": 0.1, "most_torque": 120.0, "base_speed": 75.0}
    ours = paper.run(Conditions(spread=0, imperfect=0, noisy=False, outage_length=0), [1], lambda _: effects)
    assert theirs.max_abs_error > 0.01
    assert ours.mse == pytest.approx(theirs.mse, rel=1e-5)
    assert ours.largest_error == pytest.approx(theirs.max_abs_error, rel=1e-5)
    assert ours.peak_tension == pytest.approx(theirs.peak_tension, rel=1e-5)
    assert ours.min_tension == pytest.approx(theirs.min_tension, rel=1e-4)


def test_a_log_has_what_a_data_logger_records(paper: Judge) -> None:
    drawn, rows = paper.log(Conditions(imperfect=0.0, outage_length=0.0), 1, gains_of(1), every=1000)
    assert rows.shape == (50, len(LOGGED))
    np.testing.assert_allclose(rows[:, 0], np.arange(50.0))
    assert abs(rows[30, 1] - 37.0) < 5.0, "under way to 46.8 m"
    nominal = np.array([1e4, 0.3, 0.1, 80e9, 80e9])
    np.testing.assert_array_less(np.abs(drawn / nominal - 1), [0.1, 0.2, 0.5, 0.1, 0.1])


@pytest.mark.slow
def test_every_seed_is_a_machine_of_its_own_and_the_same_again(paper: Judge) -> None:
    first, again = (paper.run(Conditions(), [3, 4]) for _ in range(2))
    assert np.array_equal(first.mse, again.mse)
    assert first.mse[0] != first.mse[1]


def test_what_a_silent_sensor_says_is_refused_by_a_controller_without_an_estimator(paper: Judge) -> None:
    """Half a second in every five: five hundred samples, from half to one and a half of that."""
    runs = paper.run(Conditions(outage_length=0.5, outage_period=5.0, missing=True), [1])
    assert not runs.clean.any()
    assert 2_500 <= runs.refused[0] <= 7_500


def test_a_row_leaves_out_what_no_controller_can_follow() -> None:
    paper = runs(mse=[4.4e-5, 2e-6, 9.0], slack=[3, 0, 0])
    tuned = runs(mse=[1e-6, 1e-6, 9.0], needed=[5000.0, 5000.0, 5600.0])
    assert judged("here", paper, tuned, 5500.0) == [
        "here",
        "23 / 1",
        "23 ×",
        "0.10 / 0.10",
        "5000 / 5000",
        "300 / 300",
        "7.0 / 7.0",
        "1 / 0",
        "1",
    ]


def runs(**changed: list[float]) -> Runs:
    """Three runs, all as good."""
    usual = {
        "samples": SAMPLES,
        "refused": 0,
        "mse": 1e-6,
        "largest_error": 1e-4,
        "peak_tension": 5000.0,
        "min_tension": 300.0,
        "chatter": 7.0,
        "slack": 0,
        "needed": 5000.0,
        "least_gear": 0.0,
    }
    return Runs(**{name: np.array(changed.get(name, [value] * 3)) for name, value in usual.items()})


def test_a_controller_that_takes_more_than_there_is_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="the controller takes x_ref_ahead_1; the machine has x, v, F1"):
        Judge(override(Experiment(), {"controller.kind": "mpc"}), tmp_path)
