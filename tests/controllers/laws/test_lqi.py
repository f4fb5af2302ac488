from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from dualwinch.codegen.source.hoist import hoisted
from dualwinch.controllers.laws.lqi import Lqi, LqiState
from dualwinch.controllers.laws.pid_cascade import PidCascade
from dualwinch.controllers.parts import PositionLaw
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import case
from tests.controllers.laws.samples import T, step

weights = st.builds(
    Lqi,
    position=st.floats(-5, -2).map(lambda power: 10**power),
    speed=st.floats(-4, 0).map(lambda power: 10**power),
    integral=st.floats(-5, -2).map(lambda power: 10**power),
    acceleration=st.floats(-3, 1).map(lambda power: 10**power),
)
"""All that is searched when it is tuned."""


def motion(sample_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matrices of integral, position and speed over a sample."""
    A = np.array([[1, sample_time, 0], [0, 1, sample_time], [0, 0, 1]])
    return A, np.array([[0], [sample_time**2 / 2], [sample_time]])


def optimal_gain(law: Lqi, sample_time: float) -> NDArray[np.float64]:
    """Gain on integral, position and speed, by SciPy; in units of the sample time, in which it is well conditioned."""
    units = np.diag([sample_time, 1.0, 1 / sample_time])
    A, B = motion(sample_time)
    A, B = np.linalg.solve(units, A @ units), np.linalg.solve(units, B) / sample_time**2
    Q = np.diag((law.acceleration * sample_time**2 / np.array([law.integral, law.position, law.speed])) ** 2)
    X = solve_discrete_are(A, B, Q @ units**2, np.eye(1))
    return (np.linalg.solve(1 + B.T @ X @ B, B.T @ X @ A) @ np.linalg.inv(units)).ravel() / sample_time**2


@given(weights, st.sampled_from([5e-4, 1e-3, 1e-2]))
def test_the_gain_solves_the_riccati_equation_wherever_it_is_tuned(law: Lqi, sample_time: float) -> None:
    assert law.gain(sample_time) == pytest.approx(optimal_gain(law, sample_time), rel=1e-9)


@given(weights)
def test_the_loop_of_its_model_is_stable(law: Lqi) -> None:
    A, B = motion(T)
    assert np.abs(np.linalg.eigvals(A - B @ np.array([law.gain(T)]))).max() < 1


def test_no_other_gains_cost_less() -> None:
    """From an error of 1 mm, on the mass alone, over 20 s: gains 2 % off cost more, each of them."""
    law, (A, B) = Lqi(), motion(T)
    scales = 1 / np.array([law.integral, law.position, law.speed])

    def cost(gain: NDArray[np.float64]) -> float:
        state, total = np.array([[0.0], [1e-3], [0.0]]), 0.0
        for _ in range(20_000):
            w = -gain @ state
            total += float(np.sum((scales * state.ravel()) ** 2) + (w[0] / law.acceleration) ** 2)
            state = A @ state + B * w
        return total

    best = np.array(law.gain(T))
    for change in np.eye(3) * 0.02:
        assert cost(best) < min(cost(best * (1 + change)), cost(best * (1 - change)))


def test_one_sample_by_hand() -> None:
    law = Lqi()
    on_integral, on_position, on_speed = optimal_gain(law, T)
    state, output = step(law, LqiState(1e-4), 3e-4, 1e-3)
    assert output.u == pytest.approx(-1e4 * (1e-4 * on_integral + 3e-4 * on_position + 1e-3 * on_speed))
    assert state.integral == pytest.approx(1e-4 + T * 3e-4)


@pytest.mark.parametrize("side", [-1, 1])
def test_the_integral_is_held_only_where_it_would_wind_up(side: int) -> None:
    state, output = step(Lqi(), LqiState(0.0), side * 1.0)
    assert abs(output.u_sat) == 5800
    assert state.integral == 0
    wound, output = step(Lqi(), LqiState(side * 1.0), -side * 1e-3)
    assert abs(output.u_sat) == 5800
    assert wound.integral == pytest.approx(side * (1.0 - T * 1e-3))


def test_the_gain_is_worked_out_once_a_run() -> None:
    """Of the step, the C code has little more than with the cascade; the doubling steps are in what is derived."""

    def sizes(law: PositionLaw) -> list[int]:
        experiment = replace(case(4), controller=replace(case(4).controller, law=law))
        return [function.n_instructions() for function in hoisted(closed_loop(structure_of(experiment)).step)]

    (once, every), (plain_once, plain_every) = sizes(Lqi()), sizes(PidCascade())
    assert once > plain_once + 5000
    assert every < plain_every + 60


def test_the_gain_has_derivatives() -> None:
    position = ca.SX.sym("position")
    gain = ca.vertcat(*replace(Lqi(), position=position).gain(T))
    slope = np.array(ca.Function("slope", [position], [ca.jacobian(gain, position)])(2e-3)).ravel()
    above, below = (np.array(Lqi(position=2e-3 + change).gain(T)) for change in (1e-7, -1e-7))
    assert slope == pytest.approx((above - below) / 2e-7, rel=1e-5)
