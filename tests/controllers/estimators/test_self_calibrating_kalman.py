"""Self-calibrating filter: measurements fed by hand, with what goes wrong on rigs, and whole runs of imperfect ones."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from benchmarks.embedded.host import PRECISE, Host, build
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.codegen.source.operations import Precision
from dualwinch.controllers.estimators.kalman import KalmanGains, kalman_gain
from dualwinch.controllers.estimators.self_calibrating_kalman import (
    SelfCalibratingEstimate,
    SelfCalibratingKalman,
    SensorWatch,
    blended_gain,
    watched,
)
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Measurement
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.vehicle import drag, friction
from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.tolerances import close

T, SIGMA = 1e-3, 6e-4
NAMES = [field.name for field in fields(Measurement)]
OUTPUTS = list(leaves(SelfCalibratingEstimate(*[0.0] * len(NAMES))))


@cache
def step_function() -> ca.Function:
    """``(state, measurement) -> (next state, estimate)`` of the filter with its default gains."""
    filter_, context = SelfCalibratingKalman(), Context(Plant(), Limits(), T)
    start = filter_.initial_state()
    state, measured = ca.SX.sym("state", len(leaves(start))), ca.SX.sym("measured", len(NAMES))
    before = with_leaves(start, dict(zip(leaves(start), ca.vertsplit(state), strict=True)))
    after, estimate = filter_.step(before, Measurement(*ca.vertsplit(measured)), Setpoint(0.0, 0.0, 0.0), context)
    outputs = [ca.vertcat(*leaves(group).values()) for group in (after, estimate)]
    return ca.Function("filter", [state, measured], outputs, {"cse": True})


@dataclass(frozen=True)
class Drive:
    """A vehicle that starts from rest, and what a rig's sensors say of it."""

    x: np.ndarray
    measured: np.ndarray

    def changed(self, name: str, change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> "Drive":
        """With one sensor's values (n) changed, given them and the time."""
        column, measured = NAMES.index(name), self.measured.copy()
        measured[:, column] = change(measured[:, column], T * np.arange(len(measured)))
        return replace(self, measured=measured)

    def filtered(self) -> dict[str, np.ndarray]:
        """What the filter gives, by name, and its error in m as ``error``."""
        state = np.array(list(leaves(SelfCalibratingKalman().initial_state()).values()), dtype=float)
        rows = np.empty((len(self.measured), len(OUTPUTS)))
        for row, measured in zip(rows, self.measured, strict=True):
            state, estimate = (np.array(value).ravel() for value in step_function()(state, measured))
            row[:] = estimate
        assert np.isfinite(state).all()
        assert np.isfinite(rows).all()
        found = dict(zip(OUTPUTS, rows.T, strict=True))
        return found | {"error": found["x"] - self.x}


@cache
def drive(scale: float = 2e-3, zero: float = 1e-3, duration: float = 10.0, seed: int = 1) -> Drive:
    """Up to 1 m/s in 5 s; drum 1 is larger by `scale` and drum 2 smaller, encoders are off by a zero in m."""
    t, plant, random = T * np.arange(round(duration / T)), Plant(), np.random.default_rng(seed)
    a = np.where(t < 5, 0.2, 0.0)
    v = np.minimum(0.2 * t, 1.0)
    x = np.where(t < 5, 0.1 * t**2, 2.5 + (t - 5))
    resistance = np.array([float(friction(speed, plant.vehicle) + drag(speed, plant.vehicle)) for speed in v])
    F1 = 3000 + (1e4 * a + resistance) / 2
    F2 = 6000 - F1
    stretch_1, stretch_2 = F1 * (50.5 - x) / (80e9 * 4.52e-4), F2 * (0.5 + x) / (80e9 * 4.52e-4)
    theta_1 = (x + stretch_1) / (0.8 * (1 + scale)) + zero / 0.8
    theta_2 = (stretch_2 - x) / (0.8 * (1 - scale)) - zero / 0.8
    reading = np.round((x + 5e-4 * random.standard_normal(len(t))) / 1e-3) * 1e-3
    speed = v + 2e-3 * random.standard_normal(len(t))
    return Drive(x, np.column_stack([reading, speed, F1, F2, v / 0.8, -v / 0.8, theta_1, theta_2]))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_it_finds_drums_and_zeros_and_with_them_the_position() -> None:
    found = drive().filtered()
    assert found["scale_1"][-1] == pytest.approx(2e-3, abs=3 * found["scale_1_sd"][-1])
    assert found["scale_2"][-1] == pytest.approx(-2e-3, abs=3 * found["scale_2_sd"][-1])
    assert found["scale_1_sd"][-1] < 5e-5
    assert found["scale_1_sd"][500] == pytest.approx(2e-3, rel=0.2)
    assert found["zero_1"][-1] == pytest.approx(1e-3, abs=3 * found["zero_1_sd"][-1])
    assert rms(found["error"][2000:]) < SIGMA / 15
    assert np.abs(found["error"]).max() < SIGMA / 3
    assert not found["fault_1"].any()
    assert found["position_used"].mean() > 0.999


def test_what_is_as_its_data_sheet_says_costs_little_noise() -> None:
    """Exact drums and zeros: least squares alone would let through some three times as much."""
    exact = drive(scale=0.0, zero=0.0).filtered()
    assert rms(exact["error"][2000:]) < rms(drive().filtered()["error"][2000:]) / 2


def silent(reading: np.ndarray, t: np.ndarray, how: str) -> np.ndarray:
    outage = (t >= 7) & (t < 9)
    return np.where(outage, np.nan if how == "nan" else reading[6999], reading)


@pytest.mark.parametrize("how", ["nan", "held"])
def test_a_silent_sensor_is_done_without_and_nothing_jumps_when_it_is_back(how: str) -> None:
    found = drive().changed("x", lambda reading, t: silent(reading, t, how)).filtered()
    assert not found["position_used"][7050:8999].any()
    assert found["position_used"][9005:].all()
    assert np.abs(found["error"][2000:]).max() < SIGMA / 5
    assert np.abs(np.diff(found["error"][6990:])).max() < 1e-5
    assert max(found["fault_1"].max(), found["fault_2"].max()) < 0.1


def test_a_silent_sensor_at_the_start_is_no_harm() -> None:
    found = drive().changed("x", lambda reading, t: np.where(t < 0.5, np.nan, reading)).filtered()
    assert np.abs(found["error"]).max() < SIGMA / 3


def test_outliers_are_left_out() -> None:
    wild = np.random.default_rng(4).random(10_000) < 0.05
    found = drive().changed("x", lambda reading, _: np.where(wild, reading + 1.0, reading)).filtered()
    assert not found["position_used"][wild & (np.arange(10_000) > 10)].any()
    assert rms(found["error"][2000:]) < SIGMA / 10


def test_an_encoder_that_jumps_is_suspect_learnt_anew_and_trusted_again() -> None:
    jumped = drive().changed("theta_1", lambda angle, t: angle + np.where(t < 7, 0.0, 0.01 / 0.8))
    found = jumped.filtered()
    assert found["fault_1"][7000:7200].max() > 0.8
    assert found["fault_1"][8500:].mean() < 0.05
    assert found["fault_2"].max() < 0.1
    assert np.abs(found["error"]).max() < SIGMA
    assert np.abs(found["d_est"][7000:] - found["d_est"][6999]).max() < 0.2


def test_a_rope_that_slips_stays_suspect_and_the_other_leads() -> None:
    slipping = drive().changed("theta_1", lambda angle, t: angle + np.where(t < 6, 0.0, 0.1 * (t - 6)))
    found = slipping.filtered()
    assert found["fault_1"][7000:].min() > 0.5
    assert np.abs(found["error"]).max() < SIGMA


@pytest.mark.parametrize("scale", [0.05, -0.05])
def test_drums_far_beyond_the_prior_end_with_the_sensor(scale: float) -> None:
    found = drive(scale=scale).filtered()
    assert rms(found["error"][3000:]) < SIGMA / 3
    assert np.abs(found["error"]).max() < 5 * SIGMA


def test_a_wrong_start_slides_into_the_frame_of_the_sensor() -> None:
    """The sensor reads 2 mm more than the start says."""
    found = drive().changed("x", lambda reading, _: reading + 2e-3).filtered()
    slide = found["error"]
    assert abs(slide[0]) < 1e-4
    assert close(slide[1000:], 2e-3, abs=SIGMA / 3)
    assert np.abs(np.diff(slide)).max() < 5e-5
    assert np.abs(found["d_est"]).max() < 0.1


def test_a_reading_is_none_if_it_is_no_number_or_repeats_itself() -> None:
    watch, alive = watched(SensorWatch(), np.nan, 1.5, 2)
    assert (watch.reading, alive, watch.started) == (1.5, 0, 1)
    lives = []
    for reading in (2.0, 2.0, 2.0, 2.0, 2.001):
        watch, alive = watched(watch, reading, 1.5, 2)
        lives.append(alive)
    assert lives == [1, 1, 1, 0, 1]


def test_the_gain_lies_between_that_of_the_sensor_alone_and_that_of_all() -> None:
    gains = KalmanGains()
    alone = kalman_gain(replace(gains, encoder_noise=1e3), T)
    # a filter of the same bandwidth whose encoders say nothing
    assert np.array(blended_gain(gains, 0.0, T)) == pytest.approx(np.array(alone), rel=1e-6)
    assert np.array(blended_gain(gains, 1.0, T)) == pytest.approx(np.array(kalman_gain(gains, T)), rel=1e-12)


KIND = {"controller.estimator": "self-calibrating-kalman"}
SENSORS = {
    "sensors.position_noise": 5e-4,
    "sensors.position_resolution": 1e-3,
    "sensors.position_bias": 2e-3,
    "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 10.0,
    "sensors.encoder_counts": 4096,
    "sensors.encoder_zero_1": 1e-3,
    "sensors.encoder_zero_2": -1e-3,
    "sensors.outage_length": 0.5,
    "sensors.outage": "missing",
}
DRUMS = {
    "plant.winch_1.radius_error": 2e-3,
    "plant.winch_2.radius_error": -1.5e-3,
    "plant.winch_1.eccentricity": 1e-4,
    "plant.rope_1.modulus": 74e9,
}


def rig(duration: float = 12.0) -> Scenario:
    """Case 4 on a machine whose controller assumes the plant of the paper."""
    changes = {"simulation.duration": duration, "simulation.seed": 3}
    return Scenario(0, override(case(4), KIND | SENSORS | DRUMS | changes), Plant(), {})


def test_on_an_imperfect_rig_the_estimate_is_in_the_sensors_frame() -> None:
    result = simulate(rig().experiment, nominal=Plant())
    assert result.outcome == "completed"
    error = result["x_est"] - result["x"] - 2e-3
    assert rms(error[result["t"] > 2]) < SIGMA / 10
    assert result["scale_1"][-1] == pytest.approx(2e-3, abs=1e-4)
    assert result["scale_2"][-1] == pytest.approx(-1.5e-3, abs=1e-4)
    assert result.metrics.slack_share == 0


@pytest.mark.slow
def test_margins_are_those_of_a_filter_that_knows_the_machine() -> None:
    """What is learnt slowly takes nothing from the margins, and learning is stable."""
    plain, learning = (
        margins(linear_open_loop(override(case(4), {"controller.estimator": kind}), 25.0, 0.5))
        for kind in ("kalman", "self-calibrating-kalman")
    )
    assert learning.stable
    assert learning.gain == pytest.approx(plain.gain, rel=1e-2)
    assert np.abs(linear_closed_loop(override(case(4), KIND), 25.0, 0.5).poles()).max() < 1


@pytest.mark.slow
def test_exported_in_single_precision_it_knows_the_position_as_well(tmp_path: Path) -> None:
    made = block("controller", override(case(4), KIND))
    estimate = [variable.name for variable in made.outputs].index("x_est")
    inputs = {variable.name: column for column, variable in enumerate(made.inputs)}
    driven, found = drive(), {}
    given = np.zeros((len(driven.x), len(inputs)))
    for name in NAMES:
        if name in inputs:
            given[:, inputs[name]] = driven.measured[:, NAMES.index(name)]
    builds: tuple[tuple[Precision, tuple[str, ...]], ...] = (("double", ()), ("float", PRECISE))
    for precision, flags in builds:
        folder = tmp_path / precision
        folder.mkdir()
        source = c_package(made, made.name, Provenance("dualwinch", "test", "2026-01-01"), precision)
        host = Host(build(folder, source, made.name, find_compiler().command, *flags), made.name, made, precision)
        found[precision] = host.run(given)[:, estimate]
    error = found["double"] - driven.x
    assert rms(error[2000:]) < SIGMA / 15
    # a position of 7 m has steps of 0.5 µm in single precision, a drum angle of 9 rad as well
    assert np.abs(found["float"] - found["double"]).max() < 2e-5
