from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.ropes import Track, rope_lengths


def test_rope_1_is_longest_and_rope_2_shortest_at_the_start() -> None:
    assert rope_lengths(0.0, Track()) == (50.5, 0.5)
    assert rope_lengths(50.0, Track()) == (0.5, 50.5)


@given(st.floats(-100, 200))
def test_no_position_makes_a_length_zero_or_negative(x: float) -> None:
    assert min(rope_lengths(x, Track())) >= 0.05
