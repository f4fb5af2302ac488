"""Machines without a speed sensor: the filters' speed is that of positions and encoders."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

import dualwinch as dw
from dualwinch.controllers.estimators.kalman import KalmanGains, kalman_gain
from dualwinch.simulation.blocks import block

FILTERS = ("kalman", "calibrating-kalman", "self-calibrating-kalman")
NOISE = {"sensors.position_noise": 5e-4, "sensors.tension_noise": 10.0, "sensors.encoder_counts": 4096}
WITHOUT = {"sensors.speed": "none", "controller.kalman.speed_sensor": False}


@pytest.mark.parametrize("estimator", FILTERS)
def test_nothing_hangs_on_a_reading_that_there_is_not(estimator: str) -> None:
    """The run is that of a filter that does not read a wheel, and the estimate is better than a difference."""
    base = dw.override(
        dw.case(4),
        NOISE
        | {"controller.estimator": estimator, "simulation.duration": 1.0}
        | {"simulation.readings": True, "simulation.engine": "interpreter"},
    )
    without = dw.simulate(dw.override(base, WITHOUT))
    unread = dw.simulate(dw.override(base, {"controller.kalman.speed_sensor": False}))
    assert without.outcome == "completed"
    assert np.isnan(without["v_read"]).all()
    assert np.array_equal(without["e"], unread["e"])
    deviation = np.std(without["v_est"] - without["v"])
    assert deviation < np.std(np.diff(without["x_read"]) / 1e-3 - without["v"][1:]) / 100


def test_the_gain_is_that_of_positions_alone() -> None:
    """Against SciPy's solution of the Riccati equation."""
    gains, step = KalmanGains(speed_sensor=False), 1e-3
    motion = np.array([[1, step, step**2 / 2], [0, 1, step], [0, 0, 1]])
    variance = 1 / (1 / gains.position_noise**2 + 2 / gains.encoder_noise**2)
    walk = gains.bandwidth**6 * variance * step**2
    powers = np.array([[step**4 / 20, step**3 / 8, step**2 / 6], [step**3 / 8, step**2 / 3, step / 2]])
    covariance = walk * np.array([*powers, [step**2 / 6, step / 2, 1]])
    row = np.array([[1.0, 0.0, 0.0]])
    h = solve_discrete_are(motion.T, row.T, covariance, [[variance]])
    expected = (h @ row.T / (row @ h @ row.T + variance)).ravel()
    assert np.array(kalman_gain(gains, step)) == pytest.approx(np.column_stack([expected, np.zeros(3)]), rel=1e-6)


def test_exported_controllers_have_no_input_for_it() -> None:
    experiment = dw.override(dw.case(4), {**NOISE, **WITHOUT, "controller.estimator": "kalman"})
    assert "v" not in {variable.name for variable in block("controller", experiment).inputs}
