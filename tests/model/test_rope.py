import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.rope import Rope, Track, rope_lengths, stiffness, tension

ROPE = Rope()
stretches = st.floats(-1, 1)
rates = st.floats(-10, 10)
lengths = st.floats(0.05, 100)


@given(stretches, rates, lengths)
def test_tension_is_never_negative(stretch: float, rate: float, length: float) -> None:
    assert tension(stretch, rate, length, ROPE) >= 0


@given(stretches, rates, lengths)
def test_taut_rope_is_spring_plus_damper(stretch: float, rate: float, length: float) -> None:
    pull = 80e9 * 4.52e-4 / length * stretch + 1000 * rate
    expected = pull if stretch > 0 and pull > 0 else 0.0
    assert tension(stretch, rate, length, ROPE) == pytest.approx(expected, rel=1e-12, abs=1e-6)
    assert tension(stretch, rate, length, ROPE, slack=False) == pytest.approx(pull, rel=1e-12, abs=1e-6)


def test_damper_cannot_pull_on_a_loose_rope() -> None:
    assert tension(-1e-9, 5.0, 10.0, ROPE) == 0


def test_a_fast_shortening_stretched_rope_does_not_push() -> None:
    assert tension(1e-6, -5.0, 10.0, ROPE) == 0


def test_rope_1_is_longest_and_rope_2_shortest_at_the_start() -> None:
    assert rope_lengths(0.0, Track()) == (50.5, 0.5)
    assert rope_lengths(50.0, Track()) == (0.5, 50.5)


@given(st.floats(-100, 200))
def test_no_position_makes_a_length_zero_or_negative(x: float) -> None:
    assert min(rope_lengths(x, Track())) >= 0.05


def test_twice_the_rope_is_half_as_stiff() -> None:
    assert stiffness(1.0, ROPE) == pytest.approx(36.16e6)
    assert stiffness(2.0, ROPE) == pytest.approx(18.08e6)
