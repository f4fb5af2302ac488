"""Late sensors: readings of what was true a delay ago, and a filter that knows the delay."""

import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.analysis.sensor_remarks import sensor_remarks
from dualwinch.controllers.estimators.kalman import KalmanGains, kalman_gain
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

LATE = {
    "sensors.position_delay": 7.3e-3,
    "sensors.speed_delay": 4.2e-3,
    "sensors.tension_delay": 2e-3,
    "sensors.encoder_delay": 3.1e-3,
}
NOISY = {
    "sensors.position_noise": 5e-4,
    "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 10.0,
    "sensors.encoder_counts": 4096,
    "simulation.duration": 20.0,
}


def settings(**values: float | str | bool) -> dict[str, float | str | bool]:
    return {name.replace("__", "."): value for name, value in values.items()}


def test_readings_are_what_was_true_a_delay_ago() -> None:
    result = simulate(override(case(4), {**LATE, "simulation.readings": True, "simulation.duration": 2.0}))
    columns, t = result.columns, result.columns["t"]
    pairs = {
        "x": "position",
        "v": "speed",
        "F1": "tension",
        "F2": "tension",
        "theta_1": "encoder",
        "omega_2": "encoder",
    }
    # positions are interpolated by the simulation as parabolas, here by straight lines
    allowed = {"x": 1e-7, "theta_1": 1e-6}
    for name, sensor in pairs.items():
        expected = np.interp(t - LATE[f"sensors.{sensor}_delay"], t, columns[name])
        assert columns[f"{name}_read"][20:] == pytest.approx(expected[20:], abs=allowed.get(name, 1e-9))
        assert np.abs(columns[f"{name}_read"] - columns[name]).max() > 1e-4


def test_a_slow_sensor_reads_at_its_rate_and_holds() -> None:
    changes = settings(sensors__position_rate=50.0, simulation__readings=True, simulation__duration=1.0)
    columns = simulate(override(case(4), changes)).columns
    steps = np.arange(1000) // 20 * 20
    assert np.array_equal(columns["x_read"], columns["x"][steps])


@pytest.mark.slow
def test_delays_may_differ_between_lanes() -> None:
    key, delays = "sensors.position_delay", (1e-3, 5.5e-3, 20e-3)
    base = override(case(4), {key: 5e-3, "simulation.duration": 0.5})
    scenarios = [Scenario(place, base, base.plant, {key: delay}) for place, delay in enumerate(delays)]
    lanes = rollout([], [[]], scenarios).metrics["mse"][0]
    varied = rollout([key], [[delay] for delay in delays], [base]).metrics["mse"][:, 0]
    alone = [simulate(scenario.experiment, stride=0).metrics.mse for scenario in scenarios]
    assert lanes == pytest.approx(alone, rel=1e-9)
    assert varied == pytest.approx(alone, rel=1e-9)
    with pytest.raises(ConfigurationError, match=r"parameters\[0\]: sensors.position_delay = 0.04: must be <= 0.032 s"):
        rollout([key], [[0.04]], [base])


def blunder(experiment: Experiment) -> float:
    """Root mean square error in m of the estimated position."""
    columns = simulate(experiment).columns
    return float(np.sqrt(np.mean((columns["x_est"] - columns["x"]) ** 2)))


@pytest.mark.parametrize(
    ("estimator", "sensor", "delay"),
    [
        ("kalman", "position", 20e-3),
        ("kalman", "speed", 20e-3),
        ("kalman", "encoder", 5e-3),
        ("calibrating-kalman", "position", 20e-3),
        ("self-calibrating-kalman", "position", 20e-3),
    ],
)
@pytest.mark.slow
def test_a_filter_that_knows_a_delay_loses_little_by_it(estimator: str, sensor: str, delay: float) -> None:
    base = override(case(4), {**NOISY, "controller.estimator": estimator})
    late = override(base, {f"sensors.{sensor}_delay": delay})
    told = override(late, {f"controller.kalman.{sensor}_delay": delay})
    believed = override(late, {"controller.trust.false_alarm": 0.0})  # else the gate may do without a late speed
    assert blunder(told) < 1.5 * blunder(base) < 0.5 * blunder(believed)


@pytest.mark.slow
@pytest.mark.parametrize("off", [-1e-3, 1e-3])
def test_what_is_not_known_of_a_delay_is_learnt(off: float) -> None:
    late = {**NOISY, "sensors.position_delay": 5e-3, "controller.kalman.position_delay": 5e-3 + off}
    base = override(case(4), {**late, "controller.estimator": "self-calibrating-kalman"})
    learning = override(base, {"controller.drums.delay": 1e-3})
    columns = simulate(learning).columns
    assert columns["delay_1"][-1] == pytest.approx(-off, abs=3 * columns["delay_1_sd"][-1])
    assert blunder(learning) < blunder(base) / 4


def test_the_gain_for_a_late_position_is_stable_where_that_for_a_punctual_one_is_not() -> None:
    """Of the error of the prediction against a reading taken back by the motion, at 100 ms and 30 rad/s."""
    h, delay = 1e-3, 0.1
    move = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]])
    seen = np.array([[1, -delay, delay * delay / 2], [0, 1, 0]])

    def growth(gains: KalmanGains) -> float:
        gain = np.array(kalman_gain(gains, h, encoders=False))
        gain[:, 1] = 0.0  # without a speed sensor
        return np.abs(np.linalg.eigvals(move @ (np.eye(3) - gain @ seen))).max()

    assert growth(KalmanGains(speed_noise=1e6, bandwidth=30.0)) > 1
    assert growth(KalmanGains(speed_noise=1e6, bandwidth=30.0, position_delay=delay)) < 1


def test_margins_are_smaller_where_sensors_are_late() -> None:
    late = override(case(4), {"sensors.speed_delay": 5e-3, "sensors.position_delay": 5e-3})
    punctual, lagging = (margins(linear_open_loop(each, 25.0, 0.5)) for each in (case(4), late))
    assert punctual.stable
    assert lagging.delay < punctual.delay


def test_a_delay_beyond_the_memory_is_an_error_that_says_how_much_it_takes() -> None:
    with pytest.raises(ConfigurationError, match=r"sensors.speed_delay = 0.05: .* 0.032 s.* sensors.memory >= 50"):
        prepare(override(case(4), {"sensors.speed_delay": 0.05}))
    prepare(override(case(4), {"sensors.speed_delay": 0.05, "sensors.memory": 50}))


def test_sensors_that_the_controller_takes_for_better_are_said() -> None:
    kalman = {"controller.estimator": "self-calibrating-kalman"}
    late = {"sensors.position_delay": 5e-3, "sensors.position_rate": 10.0, "sensors.tension_noise": 10.0}
    words = sensor_remarks(override(case(4), {**kalman, **late}))
    assert [text.partition(" ")[0] for text in words] == [
        "sensors.position_delay",
        "sensors.position_rate",
        "sensors.speed_noise",
    ]
    told = {"controller.kalman.position_delay": 5e-3, "controller.trust.position_rate": 10.0}
    assert not sensor_remarks(override(case(4), {**kalman, **late, **told, "sensors.speed_noise": 1e-3}))
