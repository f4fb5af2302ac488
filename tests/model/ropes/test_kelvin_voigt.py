from dataclasses import dataclass
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.ropes import Rope, is_kelvin_voigt, kelvin_voigt, one_sided, stiffness, tangent_rope
from tests.own_ropes import Fading

ROPE = Rope()
stretches = st.floats(-1, 1)
rates = st.floats(-10, 10)
lengths = st.floats(0.05, 100)


def tension(stretch: float, rate: float, length: float) -> float:
    return one_sided(stretch, ROPE.tension(stretch, rate, length))


@given(stretches, rates, lengths)
def test_tension_is_never_negative(stretch: float, rate: float, length: float) -> None:
    assert tension(stretch, rate, length) >= 0


@given(stretches, rates, lengths)
def test_taut_rope_is_spring_plus_damper(stretch: float, rate: float, length: float) -> None:
    pull = 80e9 * 4.52e-4 / length * stretch + 1000 * rate
    expected = pull if stretch > 0 and pull > 0 else 0.0
    assert tension(stretch, rate, length) == pytest.approx(expected, rel=1e-12, abs=1e-6)
    assert ROPE.tension(stretch, rate, length) == pytest.approx(pull, rel=1e-12, abs=1e-6)
    assert ROPE.pull(stretch, rate, length, 1 / length) == pytest.approx(pull, rel=1e-12, abs=1e-6)


def test_damper_cannot_pull_on_a_loose_rope() -> None:
    assert tension(-1e-9, 5.0, 10.0) == 0


def test_a_fast_shortening_stretched_rope_does_not_push() -> None:
    assert tension(1e-6, -5.0, 10.0) == 0


def test_twice_the_rope_is_half_as_stiff() -> None:
    assert stiffness(1.0, ROPE) == pytest.approx(36.16e6)
    assert stiffness(2.0, ROPE) == pytest.approx(18.08e6)


def test_it_rests_where_its_spring_pulls_as_much() -> None:
    stretch = ROPE.resting_stretch(1000.0, 25.0)
    assert ROPE.tension(stretch, 0.0, 25.0) == pytest.approx(1000.0)
    assert ROPE.tangent(1000.0, 25.0) == (stiffness(25.0, ROPE), 1000.0)


def test_in_a_cruise_its_strain_stays() -> None:
    stretch, slope = ROPE.steady_stretch(1000.0, 25.0, -1.8)
    assert slope == pytest.approx(stretch / 25.0)
    assert ROPE.tension(stretch, -1.8 * slope, 25.0) == pytest.approx(1000.0)


@dataclass(frozen=True)
class Coloured(Rope):
    """The same law."""

    kind: ClassVar = "coloured"


def test_a_rope_made_of_it_is_one_as_long_as_it_writes_no_tension() -> None:
    assert is_kelvin_voigt(Coloured())
    assert tangent_rope(Coloured(damping=500.0), 1000.0, 25.0) == Rope(damping=500.0)
    assert not is_kelvin_voigt(Fading())
    with pytest.raises(ConfigurationError, match=r"^rope 'fading': must be a Kelvin–Voigt rope here"):
        kelvin_voigt(Fading())


def test_what_follows_from_another_tension_is_not_inherited() -> None:
    rope = Fading(modulus=50e9)
    assert rope.pull(0.01, 0.0, 25.0, 0.04) == rope.tension(0.01, 0.0, 25.0)
    assert rope.tension(rope.resting_stretch(1000.0, 25.0), 0.0, 25.0) == pytest.approx(1000.0)
    assert rope.tangent(1000.0, 25.0) == pytest.approx((0.9 * stiffness(25.0, Rope(modulus=50e9)), 900.0))
    nominal = tangent_rope(rope, 1000.0, 25.0)
    assert (nominal.modulus, nominal.damping) == (pytest.approx(45e9), pytest.approx(900.0))
