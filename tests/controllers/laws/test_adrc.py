from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.adrc import Adrc
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
    state: ExtendedState, x: float, v: float = 0.0, law: Adrc | None = None
) -> tuple[ExtendedState, ObserverOutput]:
    estimate = Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0)
    return (law or Adrc()).step(state, estimate, STILL, Context(SMOOTH, Limits(), T))


@given(st.floats(1, 200))
def test_all_poles_of_the_observer_lie_at_its_bandwidth(bandwidth: float) -> None:
    """What the expectation is wrong by, a sample later, on a vehicle at rest that then follows the command."""
    columns = []
    for wrong in np.eye(3):
        after, output = step(ExtendedState(*wrong, primed=1.0), 0.0, law=Adrc(0.0, bandwidth))
        acceleration = output.u_sat / 1e4
        columns.append([after.x - T**2 / 2 * acceleration, after.v - T * acceleration, after.d])
    expected = np.poly([np.exp(-bandwidth * T)] * 3)
    assert np.poly(np.array(columns).T) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_the_first_sample_takes_the_measured_motion() -> None:
    state, output = step(ExtendedState(), 12.0, 0.3)
    assert output.u == pytest.approx(1e4 * (-16 * 12 - 8 * 0.3))
    assert output.d_hat == 0
    assert state.x == pytest.approx(12.0, abs=1e-3)


def test_the_expectation_follows_the_saturated_command() -> None:
    state, output = step(ExtendedState(x=-3.0, primed=1.0), -3.0)
    assert (output.u, output.u_sat) == (pytest.approx(4.8e5), 5800)
    assert state.v == pytest.approx(T * 0.58)


def test_a_constant_disturbance_is_found() -> None:
    x, v, state = 0.0, 0.0, ExtendedState()
    output = None
    for _ in range(8000):
        state, output = step(state, x, v)
        acceleration = output.u_sat / 1e4 + 0.05
        x, v = x + T * v + T**2 / 2 * acceleration, v + T * acceleration
    assert output is not None
    assert output.d_hat == pytest.approx(0.05, rel=1e-6)
    assert abs(x) < 1e-9


@pytest.mark.parametrize("number", [2, 4])
def test_it_tracks_well_and_does_not_chatter(number: int, paper_run: PaperRun) -> None:
    """Steady mean |e|, Case 4: 0.54 mm, FANDO-NFTSM 3.7 mm, both with the gains they come with."""
    result, paper = simulate(case(number, "adrc")), paper_run(number, "fando-nftsm")
    assert result.outcome == "completed"
    assert result.metrics.slack_share == 0
    assert result.metrics.steady_mae < 1e-3
    assert result.metrics.max_abs_error < 2e-3
    assert result.metrics.chatter < 1.1 * paper.metrics.chatter
    window = (result["t"] > 18.5) & (result["t"] < 28.5)
    if number == 4:
        assert np.corrcoef(result["d_hat"][window], result["d_true"][window])[0, 1] > 0.9


def test_it_needs_no_speed_sensor() -> None:
    experiment = case(4, "adrc")
    blind = replace(experiment, sensors=replace(experiment.sensors, speed_noise=0.5))
    ours, theirs = simulate(blind), simulate(experiment)
    assert close(ours["x"], theirs["x"], abs=0.05)
