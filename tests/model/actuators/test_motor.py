"""The motor's exact step against SciPy's solution of the same differential equation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from dualwinch.model.actuators import Demand, Motor, MotorState

torques = st.floats(-150, 150)
SAMPLE_TIME = 1e-3


def solved(start: float, command: float, motor: Motor) -> tuple[float, float]:
    """Torque after a sample, and its mean."""
    limit = motor.rate_limit or np.inf

    def slopes(_: float, y: np.ndarray) -> list[float]:
        return [float(np.clip((command - y[0]) / motor.time_constant, -limit, limit)), y[0]]

    end = solve_ivp(slopes, (0, SAMPLE_TIME), [start, 0.0], rtol=1e-10, atol=1e-10, max_step=SAMPLE_TIME / 50).y[:, -1]
    return float(end[0]), float(end[1]) / SAMPLE_TIME


@given(torques, torques, st.floats(2e-4, 0.1), st.none() | st.floats(10, 1e5))
def test_torque_and_mean_are_those_of_the_differential_equation(
    start: float, command: float, time_constant: float, rate_limit: float | None
) -> None:
    motor = Motor(time_constant, rate_limit)
    state, mean = motor.step(MotorState(start), Demand(command, 0.0, 0.0), SAMPLE_TIME)
    assert (state.torque, mean) == pytest.approx(solved(start, command, motor), abs=1e-5)


@given(torques, st.none() | st.floats(10, 1e5))
def test_a_motor_that_gives_what_is_asked_stays_as_it_is(torque: float, rate_limit: float | None) -> None:
    motor = Motor(rate_limit=rate_limit)
    state, mean = motor.step(motor.holding_state(torque), Demand(torque, 3.0, 5.0), SAMPLE_TIME)
    assert state.torque == mean == torque


def test_a_quick_motor_is_ideal_and_a_slow_one_does_nothing() -> None:
    quick, slow = (
        Motor(time_constant).step(MotorState(10.0), Demand(50.0, 0, 0), 1e-3)[1] for time_constant in (1e-9, 1e9)
    )
    assert (quick, slow) == (pytest.approx(50.0, rel=1e-5), pytest.approx(10.0))


def test_a_rate_limit_is_kept_to() -> None:
    state, _ = Motor(1e-3, rate_limit=1000.0).step(MotorState(0.0), Demand(-100.0, 0.0, 0.0), SAMPLE_TIME)
    assert state.torque == pytest.approx(-1.0)
