"""What follows from a tension alone: by hand, by SciPy's root finding and by differences."""

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.ropes import Rope, RopeLaw, stiffness, tangent_rope
from dualwinch.model.scalar import Scalar, sqrt
from tests.own_ropes import Bedding, Stiffening


@dataclass(frozen=True)
class Plain(RopeLaw):
    """The Kelvin–Voigt rope's tension, and nothing known of it."""

    kind: ClassVar = "plain"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return Rope().tension(stretch, stretch_rate, length)


@dataclass(frozen=True)
class Power(RopeLaw):
    """A tension that is a power of the strain."""

    kind: ClassVar = "power"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return 1e15 * (stretch / length) ** 3 + 10 * stretch_rate


@dataclass(frozen=True)
class Softening(RopeLaw):
    """A spring rate that falls, and none beyond what a root can be drawn of."""

    kind: ClassVar = "softening"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return 1e5 * sqrt(stretch / length) + stretch_rate


@dataclass(frozen=True)
class Backlash(RopeLaw):
    """No tension before two per mille of strain."""

    kind: ClassVar = "backlash"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return ca.fmax(0, 2e7 * (stretch / length - 2e-3)) + stretch_rate


ROPES = [Plain(), Power(), Stiffening(), Bedding(), Softening(), Backlash(), Stiffening(soft=1.0)]
tensions, lengths = st.floats(1.0, 1e4), st.floats(0.05, 100)


@pytest.mark.parametrize("rope", ROPES, ids=lambda rope: rope.kind)
@given(tension=tensions, length=lengths)
def test_a_rope_rests_where_it_pulls_as_much(rope: RopeLaw, tension: float, length: float) -> None:
    stretch = rope.resting_stretch(tension, length)
    assert rope.tension(stretch, 0.0, length) == pytest.approx(tension, rel=1e-9)
    expected = brentq(lambda s: rope.tension(s, 0.0, length) - tension, 1e-15, length, xtol=1e-15)
    assert stretch == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("rope", [rope for rope in ROPES if rope.kind != "backlash"], ids=lambda rope: rope.kind)
@given(tension=tensions, length=lengths)
def test_spring_rate_and_damping_are_slopes_of_the_tension(rope: RopeLaw, tension: float, length: float) -> None:
    spring, damping = rope.tangent(tension, length)
    stretch = rope.resting_stretch(tension, length)
    h, rate = 1e-5 * stretch, 1e-3
    difference = rope.tension(stretch + h, 0.0, length) - rope.tension(stretch - h, 0.0, length)
    assert spring == pytest.approx(difference / (2 * h), rel=1e-4)
    difference = rope.tension(stretch, rate, length) - rope.tension(stretch, -rate, length)
    assert damping == pytest.approx(difference / (2 * rate), rel=1e-6)


@given(tension=tensions, length=lengths, length_rate=st.floats(-2, 2))
def test_a_linear_rope_gets_what_the_closed_form_says(tension: float, length: float, length_rate: float) -> None:
    found, known = Plain(), Rope()
    assert found.resting_stretch(tension, length) == pytest.approx(known.resting_stretch(tension, length), rel=1e-12)
    ours, theirs = (rope.steady_stretch(tension, length, length_rate) for rope in (found, known))
    assert ours == pytest.approx(theirs, rel=1e-12)
    assert found.tangent(tension, length) == pytest.approx(known.tangent(tension, length), rel=1e-12)
    nominal = tangent_rope(found, tension, length)
    assert (nominal.modulus, nominal.area) == (pytest.approx(80e9, rel=1e-12), 4.52e-4)


@pytest.mark.parametrize("rope", [Plain(), Stiffening(), Bedding()], ids=lambda rope: rope.kind)
def test_in_a_cruise_the_tension_stays(rope: RopeLaw) -> None:
    """The stretch is that of a moment later, moved on by its slope."""
    rate, h = 1.8, 1e-3
    stretch, slope = rope.steady_stretch(1000.0, 20.0, rate)
    later, _ = rope.steady_stretch(1000.0, 20.0 + h * rate, rate)
    assert rope.tension(stretch, rate * slope, 20.0) == pytest.approx(1000.0, rel=1e-10)
    assert later - stretch == pytest.approx(slope * h * rate, rel=1e-4)


def test_symbols_give_what_floats_give_and_can_be_differentiated() -> None:
    soft, tension = ca.SX.sym("soft"), ca.SX.sym("tension")
    stretch = with_leaves(Stiffening(), {"soft": soft}).resting_stretch(tension, 25.0)
    function = ca.Function("stretch", [soft, tension], [stretch, ca.jacobian(stretch, soft)])
    value, slope = (float(output) for output in function(4e6, 1000.0))
    assert value == pytest.approx(Stiffening().resting_stretch(1000.0, 25.0), rel=1e-14)
    around = [Stiffening(soft=4e6 + h).resting_stretch(1000.0, 25.0) for h in (-1e2, 1e2)]
    assert slope == pytest.approx((around[1] - around[0]) / 2e2, rel=1e-6)


def test_a_rope_without_a_pull_hangs_at_rest_with_next_to_no_stretch() -> None:
    assert 0 <= Stiffening().resting_stretch(0.0, 25.0) < 1e-12
    assert Rope().tangent(0.0, 2.0) == (stiffness(2.0, Rope()), 1000.0)
