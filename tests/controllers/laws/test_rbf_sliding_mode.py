import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.rbf_sliding_mode import CENTRES, RbfSlidingMode, RbfState
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.controllers.laws.samples import SMOOTH, T, step


def test_one_sample_by_hand() -> None:
    law = RbfSlidingMode(lam=2.0, eta=3.0, k=0.1, phi=0.02, rate=50.0, leakage=0.1, span=1.5, width=0.5)
    before = np.linspace(-0.03, 0.03, 7)
    state, output = step(law, RbfState(before), 0.002, 0.006)
    s = 0.002 + 0.006 / 2
    basis = [math.exp(-((0.006 - c) ** 2) / 0.5) for c in (-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5)]
    learnt = sum(w * h for w, h in zip(before, basis, strict=True))
    assert output.s == pytest.approx(s)
    assert output.d_hat == pytest.approx(learnt)
    assert output.u == pytest.approx(1e4 * (-2 * (0.006 + 3 * s + 0.1 * s / 0.02) - learnt))
    assert state.weights == pytest.approx(before + T * (50 * s * np.array(basis) - 0.1 * before))


@given(
    st.lists(st.floats(-0.5, 0.5), min_size=7, max_size=7), st.floats(-0.05, 0.05), st.floats(-3, 3), st.floats(0, 1e9)
)
def test_weights_stay_within_their_limit(weights: list[float], x: float, v: float, rate: float) -> None:
    state, _ = step(RbfSlidingMode(rate=rate, leakage=0.0), RbfState(np.array(weights)), x, v)
    assert np.abs(state.weights).max() <= 0.5


def test_nothing_is_learnt_while_the_force_is_beyond_its_limit() -> None:
    before = np.linspace(-0.2, 0.4, 7)
    state, output = step(RbfSlidingMode(), RbfState(before), 1.0)
    assert abs(output.u_sat) == 5800
    assert (state.weights == before).all()


def test_what_is_not_excited_is_forgotten() -> None:
    law = RbfSlidingMode(leakage=0.5)
    state = RbfState(np.full(7, 0.1))
    for _ in range(2000):
        state, _ = step(replace(law, rate=0.0), state, 0.0)
    assert state.weights == pytest.approx(np.full(7, 0.1 * (1 - 0.5 * T) ** 2000))


def friction(v: float) -> float:
    """Deceleration in m/s² unknown to the nominal model: soft Coulomb friction with a Stribeck dip, and drag."""
    return 0.1 * math.tanh(v / 0.6) * (1 + 0.5 * math.exp(-((v / 0.9) ** 2))) + 0.04 * v * abs(v)


@pytest.mark.slow
def test_it_learns_a_static_friction_curve() -> None:
    """While the speed swings between ± 1.9 m/s; then the curve stands in the weights, and they are frozen."""
    law = RbfSlidingMode(leakage=1e-4, rate=60.0)
    x, v, state, slow = 0.0, 0.0, RbfState(), 5e-3
    for k in range(30_000):
        t, w = k * slow, 0.6
        setpoint = Setpoint(1.9 / w * (1 - math.cos(w * t)), 1.9 * math.sin(w * t), 1.9 * w * math.cos(w * t))
        estimate = Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0)
        limits = Limits(tension_max=2e4)  # the swing alone takes more than the winches of the paper have
        state, output = law.step(state, estimate, setpoint, Context(SMOOTH, limits, slow))
        acceleration = output.u_sat / 1e4 - friction(v)
        x, v = x + slow * v + slow**2 / 2 * acceleration, v + slow * acceleration
    speeds = np.linspace(-1.8, 1.8, 37)
    curve = np.array([-friction(speed) for speed in speeds])
    learnt = np.array([float(np.dot(state.weights, law.basis(speed))) for speed in speeds])
    assert np.abs(learnt - curve).max() < 0.05 * np.abs(curve).max()
    assert np.abs(state.weights).max() < law.weight_limit


def test_more_centres_than_two_lie_evenly() -> None:
    assert np.diff(CENTRES) == pytest.approx(1 / 3)
    assert len(CENTRES) == 7


def test_the_network_is_what_makes_it_precise() -> None:
    experiment = case(4, "rbf-sliding-mode")
    law = RbfSlidingMode(rate=0.0)
    without = simulate(replace(experiment, controller=replace(experiment.controller, law=law)), stride=0)
    assert without.metrics.steady_mae > 3 * simulate(experiment, stride=0).metrics.steady_mae
