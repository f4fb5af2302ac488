from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.nftsm import NftsmOutput
from dualwinch.controllers.laws.super_twisting import SuperTwisting, SuperTwistingState
from dualwinch.model.plant import Plant
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from tests.controllers.laws.samples import T, step

SHARP = SuperTwisting(smoothing=1e-12)


def test_one_sample_by_hand() -> None:
    state, output = step(SHARP, SuperTwistingState(z=0.02), 0.003, 0.014, plant=Plant())
    s = 0.003 + 0.014 / 2
    resistance = 490 * np.tanh(1.4) + 900 * 0.014**2
    assert output.s == pytest.approx(0.01)
    assert output.u == pytest.approx(1e4 * 2 * (0.02 - 0.5 * np.sqrt(s) - 0.014) + resistance)
    assert state.z == pytest.approx(0.02 - T * 0.2)


@given(st.floats(0.3, 5), st.sampled_from([-1, 1]))
def test_the_integral_is_held_beyond_the_limit(e1: float, side: int) -> None:
    state, output = step(SHARP, SuperTwistingState(z=0.01), side * 3 * e1, plant=Plant())
    assert abs(output.u_sat) == 5800
    assert state.z == 0.01
    assert state.Z_a == pytest.approx(T * (output.u - output.u_sat))


@pytest.mark.parametrize("slope", [-0.15, 0.1, 0.15])
def test_a_disturbance_that_grows_steadily_is_taken_up(slope: float) -> None:
    """Slopes within lam * k2 / 1.1, on a vehicle that only has its mass; the smoothed sign leaves little behind."""
    free = Plant(vehicle=Vehicle(drag_coefficient=0.0, friction_coefficient=0.0))
    x, v, state, output = 0.02, 0.0, SuperTwistingState(), NftsmOutput(0.0, 0.0, 0.0, np.inf)
    for k in range(1500):
        state, output = step(SuperTwisting(), state, x, v, plant=free)
        acceleration = output.u_sat / 1e4 + slope * k * T
        x, v = x + T * v + T**2 / 2 * acceleration, v + T * acceleration
    assert abs(output.s) < 2e-3
    assert state.z == pytest.approx(-slope * 1.5 / 2, abs=0.02)


def test_without_smoothing_it_would_chatter() -> None:
    experiment = case(4, "super-twisting")
    sharp = replace(experiment, controller=replace(experiment.controller, law=SHARP))
    assert simulate(sharp).metrics.chatter > 2 * simulate(experiment).metrics.chatter
