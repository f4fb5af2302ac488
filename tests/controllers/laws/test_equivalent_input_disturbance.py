from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.equivalent_input_disturbance import Eid
from dualwinch.controllers.laws.extended_state_observer import ExtendedState, ObserverOutput
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.conftest import PaperRun
from tests.tolerances import close

T, STILL = 1e-3, Setpoint(0.0, 0.0, 0.0)
SMOOTH = Plant(vehicle=Vehicle(drag_coefficient=0.0, friction_coefficient=0.0))


def step(
    state: ExtendedState, x: float, v: float = 0.0, law: Eid | None = None
) -> tuple[ExtendedState, ObserverOutput]:
    estimate = Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0)
    return (law or Eid()).step(state, estimate, STILL, Context(SMOOTH, Limits(), T))


def error_poles(law: Eid) -> np.ndarray:
    """Poles of what the expectation is wrong by, on a vehicle at rest that then follows the command."""
    columns = []
    for wrong in np.eye(3):
        after, output = step(ExtendedState(*wrong, primed=1.0), 0.0, law=replace(law, natural_frequency=0.0))
        acceleration = output.u_sat / 1e4
        columns.append([after.x - T**2 / 2 * acceleration, after.v - T * acceleration, after.d])
    return np.linalg.eigvals(np.array(columns).T)


@given(st.floats(2, 200))
def test_with_a_slow_filter_the_observers_poles_lie_at_its_bandwidth(bandwidth: float) -> None:
    poles = error_poles(Eid(observer_bandwidth=bandwidth, filter_time=1e12))
    expected = np.poly([1.0, np.exp(-bandwidth * T), np.exp(-bandwidth * T)])
    assert np.poly(poles) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(st.floats(5, 50), st.floats(0.1, 10))
def test_it_is_stable_where_the_filter_is_slow_enough(bandwidth: float, ratio: float) -> None:
    """The continuous bound, and 5 % beside it for what sampling adds."""
    if abs(ratio - 1) < 0.05:
        return
    poles = error_poles(Eid(observer_bandwidth=bandwidth, filter_time=ratio / (2 * bandwidth)))
    assert (np.abs(poles).max() < 1) == (ratio > 1)


def test_the_filter_is_a_first_order_low_pass_of_the_estimate() -> None:
    """After one surprise: the share that the filter lets through, of the speed's correction over the sample."""
    law = Eid(observer_bandwidth=20.0, filter_time=0.1)
    _, output = step(ExtendedState(primed=1.0), 1e-3, law=law)
    wanted = (1 - np.exp(-20 * T)) ** 2 * 1e-3 / T**2
    assert output.d_hat == pytest.approx((1 - np.exp(-T / 0.1)) * wanted)


def test_the_first_sample_takes_the_measured_motion() -> None:
    state, output = step(ExtendedState(), 12.0, 0.3)
    assert output.u == pytest.approx(1e4 * (-16 * 12 - 8 * 0.3))
    assert output.d_hat == 0
    assert state.x == pytest.approx(12.0, abs=1e-3)


def test_the_expectation_follows_the_saturated_command() -> None:
    state, output = step(ExtendedState(x=-3.0, primed=1.0), -3.0)
    assert (output.u, output.u_sat) == (pytest.approx(4.8e5), 5800)
    assert state.v == pytest.approx(T * 0.58)


@pytest.mark.parametrize("disturbance", [0.05, -0.2])
def test_a_constant_input_disturbance_is_estimated_exactly_and_taken_off(disturbance: float) -> None:
    x, v, state, output = 0.0, 0.0, ExtendedState(), None
    for _ in range(8000):
        state, output = step(state, x, v)
        acceleration = output.u_sat / 1e4 + disturbance
        x, v = x + T * v + T**2 / 2 * acceleration, v + T * acceleration
    assert output is not None
    assert output.d_hat == pytest.approx(disturbance, rel=1e-9)
    assert abs(x) < 1e-11


@pytest.mark.parametrize("number", [2, 4])
def test_it_tracks_well_and_does_not_chatter(number: int, paper_run: PaperRun) -> None:
    """Steady mean |e|, Case 4: 0.26 mm, PID cascade 165 mm, both with the gains they come with."""
    result, paper = simulate(case(number, "eid")), paper_run(number, "fando-nftsm")
    assert result.outcome == "completed"
    assert result.metrics.slack_share == 0
    assert result.metrics.steady_mae < 0.3e-3
    assert result.metrics.max_abs_error < 0.7e-3
    assert result.metrics.chatter < 1.1 * paper.metrics.chatter
    window = (result["t"] > 18.5) & (result["t"] < 28.5)
    if number == 4:
        assert np.corrcoef(result["d_hat"][window], result["d_true"][window])[0, 1] > 0.95


def test_it_needs_no_speed_sensor() -> None:
    experiment = case(4, "eid")
    blind = replace(experiment, sensors=replace(experiment.sensors, speed_noise=0.5))
    ours, theirs = simulate(blind), simulate(experiment)
    assert close(ours["x"], theirs["x"], abs=0.05)
