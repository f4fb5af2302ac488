"""The gate of the self-calibrating filter: what slips, jumps or drifts is done without, and nothing else is."""

from functools import cache

import numpy as np
import pytest

from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.controllers.estimators.innovation_gate import GateState, chi_square_quantile, gated
from dualwinch.simulation.blocks import block
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.sensors import FAULTS
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

NOISY = {
    "controller.estimator": "self-calibrating-kalman",
    "sensors.position_noise": 5e-4,
    "sensors.position_resolution": 1e-3,
    "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 10.0,
    "sensors.encoder_counts": 4096,
    "simulation.duration": 16.0,
}
INTERVALS = {"sensors.fault_start": 6.0, "sensors.fault_period": 4.0}
PRESENT = {f"sensors.{name}": 1e-30 for name in FAULTS}
"""Sizes without an effect, so that all runs share their code."""


def faulty(probability: float = 1e-6, **faults: float) -> Experiment:
    sizes = {f"sensors.{name}": size for name, size in faults.items()}
    gate = {"controller.trust.false_alarm": probability}
    return override(case(4), {**NOISY, **INTERVALS, **PRESENT, **gate, **sizes})


@cache
def largest_error(probability: float = 1e-6, **faults: float) -> float:
    """Largest error of the estimated position in m."""
    columns = simulate(faulty(probability, **faults)).columns
    return float(np.abs(columns["x_est"] - columns["x"]).max())


def test_false_alarms_are_as_rare_as_asked_for() -> None:
    """Of white innovations: those of single samples within their quantile, those of means rarer."""
    rng, state, probability, alarms = np.random.default_rng(1), GateState(), 0.02, 0
    for innovation in rng.normal(size=4000):
        state = gated(state, innovation, used=1.0, unused=1.0, lasting=0.0, memory=0.02, false_alarm=probability)
        alarms += bool(state.rejected)
    assert 0.01 < alarms / 4000 < 0.06


def test_a_lasting_error_that_single_samples_hide_is_found_and_passes_again() -> None:
    rng, state, rejected = np.random.default_rng(1), GateState(), []
    for innovation in rng.normal(size=900) + 2.0 * np.repeat([0, 1, 0], 300):
        state = gated(state, innovation, used=1.0, unused=1.0, lasting=0.0, memory=0.03, false_alarm=1e-6)
        rejected.append(bool(state.rejected))
    assert chi_square_quantile(1e-6) > 2.0**2
    assert not any(rejected[:300])
    assert all(rejected[330:600])
    assert not any(rejected[700:])


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        {"speed_fault": 0.3},
        {"speed_fault": -0.03},
        {"speed_fault": 0.01, "fault_start": 11.0},
        {"position_fault": 0.02, "fault_length": 1.0},
        {"position_fault": -0.003, "fault_length": 1.0},
    ],
)
def test_faults_reach_the_estimate_without_a_gate_and_not_with_it(faults: dict[str, float]) -> None:
    sound = largest_error()
    assert largest_error(**faults) < 1.5 * sound
    assert largest_error(0.0, **faults) > 3 * sound


@pytest.mark.parametrize("estimator", ["kalman", "calibrating-kalman"])
def test_a_slipping_wheel_is_done_without_by_every_kalman_filter(estimator: str) -> None:
    def error(**sizes: float) -> float:
        short = {"controller.estimator": estimator, "simulation.duration": 7.0, "sensors.speed_fault": 0.3}
        columns = simulate(override(faulty(**sizes), short)).columns
        assert columns["speed_used"].all() == (not sizes["probability"])
        return float(np.abs(columns["v_est"] - columns["v"])[columns["t"] > 1].max())

    assert error(probability=1e-6) < 0.1 * error(probability=0.0)


@pytest.mark.slow
def test_a_push_is_no_slip() -> None:
    """The vehicle's speed by the tighter rope shows that the wheel is right."""

    def pushed(probability: float) -> tuple[float, float]:
        push = {"disturbance.push.force": -8e3, "disturbance.push.start": 8.0, "disturbance.push.duration": 0.3}
        columns = simulate(override(faulty(probability), push)).columns
        during = (columns["t"] > 8.0) & (columns["t"] < 8.3)
        return columns["speed_used"][during].mean(), np.abs(columns["e"]).max()

    (used, error), (_, ungated) = pushed(1e-6), pushed(0.0)
    assert used > 0.8
    assert error < 1.1 * ungated


@pytest.mark.slow
@pytest.mark.parametrize("faults", [{"encoder_fault_1": 0.02, "fault_length": 0.01}, {"encoder_fault_2": 0.009}])
def test_an_encoder_that_slips_is_outvoted(faults: dict[str, float]) -> None:
    assert largest_error(**faults) < 1.5e-3


@pytest.mark.slow
def test_load_cells_that_drift_matter_little() -> None:
    columns = simulate(faulty(load_cell_drift_1=80.0, load_cell_drift_2=-80.0)).columns
    assert np.abs(columns["x_est"] - columns["x"]).max() < 3 * largest_error()
    assert min(columns["F1"].min(), columns["F2"].min()) > 0


@pytest.mark.slow
def test_a_sensor_that_stays_away_is_believed_in_the_end() -> None:
    """A position that has moved for good is the frame after `hold_time`; a sound wheel is used again at once."""
    moved = faulty(position_fault=0.02, fault_length=1e3, fault_period=1e3)
    columns = simulate(override(moved, {"controller.trust.hold_time": 2.0})).columns
    t, off = columns["t"], columns["x_est"] - columns["x"]
    assert np.abs(off[t < 7.9]).max() < 2e-3
    assert off[-1000:] == pytest.approx(0.02, abs=2e-3)
    used = simulate(faulty(speed_fault=0.3)).columns["speed_used"]
    during = (t >= 6) & (t < 6.5) | (t >= 10) & (t < 10.5) | (t >= 14) & (t < 14.5)
    after = (t >= 6.7) & (t < 10) | (t >= 10.7) & (t < 14) | (t < 6)
    assert not used[during].any()
    assert used[after].mean() > 0.999


@pytest.mark.slow
def test_engines_agree_on_what_is_rejected() -> None:
    short = override(faulty(speed_fault=0.1, position_fault=0.01), {"simulation.duration": 1.0})
    short = override(short, {"sensors.fault_start": 0.3, "sensors.fault_length": 0.3})
    compiled, interpreted = (simulate(short, engine=engine).columns for engine in ("compiled", "interpreter"))
    assert np.array_equal(compiled["speed_used"], interpreted["speed_used"])
    assert np.array_equal(compiled["position_used"], interpreted["position_used"])
    assert np.abs(compiled["x_est"] - interpreted["x_est"]).max() < 1e-9


def test_without_a_probability_there_is_no_gate_in_exported_code() -> None:
    def source(probability: float) -> str:
        law = block("controller", override(case(4), {**NOISY, "controller.trust.false_alarm": probability}))
        return c_package(law, "law", Provenance("dualwinch", "test", "today"), "double")["law.h"]

    assert "gates" not in source(0.0)
    assert "gates" in source(1e-6)
