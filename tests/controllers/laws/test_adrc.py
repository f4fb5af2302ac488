import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.extended_state_observer import ExtendedState
from tests.controllers.laws.samples import T, step


@given(st.floats(1, 200))
def test_all_poles_of_the_observer_lie_at_its_bandwidth(bandwidth: float) -> None:
    """What the expectation is wrong by, a sample later, on a vehicle at rest that then follows the command."""
    columns = []
    for wrong in np.eye(3):
        after, output = step(Adrc(0.0, bandwidth), ExtendedState(*wrong, primed=1.0), 0.0)
        acceleration = output.u_sat / 1e4
        columns.append([after.x - T**2 / 2 * acceleration, after.v - T * acceleration, after.d])
    expected = np.poly([np.exp(-bandwidth * T)] * 3)
    assert np.poly(np.array(columns).T) == pytest.approx(expected, rel=1e-6, abs=1e-6)
