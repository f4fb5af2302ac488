from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.equivalent_input_disturbance import Eid
from dualwinch.controllers.laws.extended_state_observer import ExtendedState
from tests.controllers.laws.samples import T, step


def error_poles(law: Eid) -> np.ndarray:
    """Poles of what the expectation is wrong by, on a vehicle at rest that then follows the command."""
    columns = []
    for wrong in np.eye(3):
        after, output = step(replace(law, natural_frequency=0.0), ExtendedState(*wrong, primed=1.0), 0.0)
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
    _, output = step(law, ExtendedState(primed=1.0), 1e-3)
    wanted = (1 - np.exp(-20 * T)) ** 2 * 1e-3 / T**2
    assert output.d_hat == pytest.approx((1 - np.exp(-T / 0.1)) * wanted)
