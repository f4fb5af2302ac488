"""What sensors tell of encoders: what no arithmetic of the table may change."""

import pytest

from benchmarks.observability import ALL, ERRORS, PRIOR, WITHOUT_POSITION, known_after

ZERO, SCALE, _ = PRIOR[:3]


def test_at_rest_only_one_combination_of_zero_and_scale_is_seen() -> None:
    rest = known_after(25.0, 0.0)
    assert rest.deviations["zero_1"] == pytest.approx(ZERO, rel=0.01)
    assert rest.deviations["scale_1"] == pytest.approx(ZERO / 25, rel=0.05)
    start = known_after(0.0, 0.0)
    assert start.deviations["scale_1"] == pytest.approx(SCALE, rel=0.01)
    assert start.deviations["zero_1"] < ZERO / 5


def test_in_cruise_the_scale_is_seen_better_than_at_rest() -> None:
    assert known_after(25.0, 1.8).deviations["scale_1"] < known_after(25.0, 0.0).deviations["scale_1"] / 5


def test_encoders_alone_see_the_sum_of_their_zeros_and_not_where_the_vehicle_is() -> None:
    silent = known_after(25.0, 1.8, WITHOUT_POSITION)
    assert silent.sum_of_zeros < ZERO / 5
    assert silent.deviations["zero_1"] == pytest.approx(ZERO / 2**0.5, rel=0.05)
    assert silent.position > 0.5 * ZERO
    assert known_after(25.0, 1.8, ALL).position < silent.position / 50


def test_without_encoders_nothing_is_known_of_them_and_the_position_none_the_less() -> None:
    alone = known_after(25.0, 1.8, ("position", "speed"))
    assert [alone.deviations[name] for name in ERRORS] == pytest.approx(PRIOR)
    assert alone.position < 1e-4
