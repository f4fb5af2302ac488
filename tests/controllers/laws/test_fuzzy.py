import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.observer import inference, memberships
from tests.oracle.laws import fuzzy

inputs = st.floats(-3, 3)


@given(inputs)
def test_memberships_are_a_partition_of_unity(value: float) -> None:
    degrees = memberships(value)
    assert sum(degrees) == pytest.approx(1, abs=1e-15)
    assert min(degrees) >= 0
    assert sum(degree > 0 for degree in degrees) <= 2


@given(inputs, inputs)
def test_output_is_between_zero_and_one(error: float, rate: float) -> None:
    assert 0 <= inference(error, rate) <= 1 + 1e-15


@given(inputs, inputs)
def test_output_is_even_in_each_input(error: float, rate: float) -> None:
    expected = pytest.approx(inference(error, rate), abs=1e-15)
    assert inference(-error, rate) == expected
    assert inference(error, -rate) == expected


@given(inputs, inputs)
def test_inference_interpolates_the_rule_table(error: float, rate: float) -> None:
    assert inference(error, rate) == pytest.approx(fuzzy(error, rate), abs=1e-14)


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300))
def test_inputs_beyond_one_count_as_one(error: float, rate: float) -> None:
    clipped = [min(max(value, -1.0), 1.0) for value in (error, rate)]
    assert inference(error, rate) == inference(*clipped)


@pytest.mark.parametrize(
    ("error", "rate", "output"), [(0, 0, 0), (0, 1, 0.5), (0.5, 0, 0.5), (0.5, -1, 0.75), (-1, 0, 1), (0, 0.25, 0.125)]
)
def test_rules(error: float, rate: float, output: float) -> None:
    assert inference(error, rate) == pytest.approx(output)
