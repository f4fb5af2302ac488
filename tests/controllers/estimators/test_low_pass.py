import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.estimators.low_pass import SpeedFilterState, filter_speed


@given(st.floats(-5, 5), st.floats(-5, 5))
def test_a_filter_time_of_zero_passes_the_speed_on(before: float, v: float) -> None:
    assert filter_speed(SpeedFilterState(before), v, 0.0, 1e-3).v == v


def test_step_response_reaches_63_percent_after_the_filter_time() -> None:
    state = SpeedFilterState()
    for _ in range(1000):
        state = filter_speed(state, 1.0, 1.0, 1e-3)
    assert state.v == pytest.approx(1 - 1.001**-1000)
    assert state.v == pytest.approx(0.632, abs=1e-3)
