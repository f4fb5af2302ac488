"""The quadratic program of a sample, beside a simulation of the motion and SciPy's Riccati solver."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.predictive.program import (
    VehicleMotion,
    Weights,
    cost_of_changes,
    cost_to_go,
    optimal_feedback,
    prediction,
    room,
    slope_of_cost,
)
from dualwinch.model.reference import Setpoint

PREDICTED = prediction(0.6, 5)
N = len(PREDICTED.times)


@given(st.floats(-2, 8), st.floats(-3, 5))
def test_beyond_the_horizon_it_costs_what_riccati_says(position: float, speed: float) -> None:
    A, B = np.eye(3, k=1), np.eye(3)[:, 2:]
    weights = 10**position, 10**speed
    expected = scipy.linalg.solve_continuous_are(A, B, np.diag([*weights, 0.0]), [[1.0]])
    assert np.array(cost_to_go(*weights)) == pytest.approx(expected, rel=1e-5)
    assert np.array(optimal_feedback(*weights)) == pytest.approx(expected[2], rel=1e-5)


def motion(changes: np.ndarray, fine: int = 20000) -> tuple[np.ndarray, np.ndarray]:
    """Position and speed at the ends of stages, summed up in small steps."""
    ends = np.append(0.0, PREDICTED.times)
    t = np.linspace(0, ends[-1], fine + 1)
    a = np.interp(t, ends, np.append(0.0, changes))
    v = np.append(0.0, np.cumsum((a[1:] + a[:-1]) / 2 * np.diff(t)))
    x = np.append(0.0, np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t)))
    return np.interp(PREDICTED.times, t, x), np.interp(PREDICTED.times, t, v)


def test_changes_of_acceleration_move_the_vehicle() -> None:
    changes = np.array([0.5, -0.3, 0.2, 0.4, -0.6])
    x, v = motion(changes)
    assert PREDICTED.of_position @ changes == pytest.approx(x, abs=1e-8)
    assert PREDICTED.of_speed @ changes == pytest.approx(v, abs=1e-8)
    assert PREDICTED.times[-1] == pytest.approx(0.6)
    assert (np.diff(PREDICTED.lengths) > 0).all()


def cost(changes: np.ndarray, weights: Weights, now: VehicleMotion, ahead: list[Setpoint], lost: np.ndarray) -> float:
    """What is to be least, put down as it is meant."""
    t = PREDICTED.times
    x, v = motion(changes - lost)
    e = now.x + t * now.v + t**2 / 2 * now.a + x - [point.x for point in ahead]
    w = now.v + t * now.a + v - [point.v for point in ahead]
    last = np.array([e[-1], w[-1], now.a + changes[-1] - lost[-1] - ahead[-1].a])
    jerks = np.diff(np.append(0.0, changes)) / PREDICTED.lengths
    beyond = last @ np.array(cost_to_go(weights.position, weights.speed)) @ last
    running = PREDICTED.weights @ (weights.position * e**2 + weights.speed * w**2)
    return running + PREDICTED.lengths @ jerks**2 + beyond


@given(st.integers(0, 1000))
def test_the_program_is_the_cost(seed: int) -> None:
    draws = np.random.default_rng(seed)
    weights, now = Weights(400.0, 20.0), VehicleMotion(*draws.standard_normal(3))
    ahead = [Setpoint(*draws.standard_normal(3)) for _ in range(N)]
    lost, changes = 0.1 * draws.standard_normal((2, N))
    quadratic, linear = (
        np.array(cost_of_changes(PREDICTED, weights)),
        slope_of_cost(PREDICTED, weights, now, ahead, lost),
    )
    found = changes @ quadratic @ changes + 2 * np.dot(linear, changes)
    expected = cost(changes, weights, now, ahead, lost) - cost(np.zeros(N), weights, now, ahead, lost)
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_room_is_what_can_be_reached() -> None:
    lower, upper = room(PREDICTED, 0.5, 0.58, 2.0)
    assert upper == pytest.approx(np.minimum(0.08, 2 * PREDICTED.times))
    assert lower == pytest.approx(np.maximum(-1.08, -2 * PREDICTED.times))
