import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.coordinations.differential_tension import tension_commands
from dualwinch.controllers.limits import Limits
from tests.oracle.laws import tension_commands as oracle_commands


@st.composite
def some_limits(draw: st.DrawFn) -> Limits:
    lower = draw(st.floats(1, 1000))
    upper = lower + draw(st.floats(10, 10_000))
    share = draw(st.floats(0.001, 0.999))
    return Limits(2 * lower + share * 2 * (upper - lower), lower, upper)


shares = st.floats(-1, 1)


@given(some_limits(), st.floats(-3, 3))
def test_commands_are_within_the_limits(limits: Limits, share: float) -> None:
    for command in tension_commands(share * limits.force, limits):
        assert limits.tension_min <= command <= limits.tension_max


@given(some_limits(), shares)
def test_difference_of_the_commands_is_the_force(limits: Limits, share: float) -> None:
    """The limits always allow it: no force within ±(tension_max - tension_min) is lost to one rope's limit."""
    u_sat = share * limits.force
    F1, F2 = tension_commands(u_sat, limits)
    assert pytest.approx(u_sat, abs=1e-9 * limits.tension_max) == F1 - F2


@given(some_limits(), shares)
def test_their_sum_is_the_preload_while_neither_is_at_a_limit(limits: Limits, share: float) -> None:
    F1, F2 = tension_commands(share * limits.force, limits)
    if limits.tension_min < min(F1, F2) and max(F1, F2) < limits.tension_max:
        assert pytest.approx(limits.preload) == F1 + F2


@given(some_limits(), st.floats(-3, 3))
def test_commands_equal_the_independent_ones(limits: Limits, share: float) -> None:
    u_sat = share * limits.force
    expected = oracle_commands(u_sat, limits.preload, limits.tension_min, limits.tension_max)
    assert tension_commands(u_sat, limits) == pytest.approx(expected)


def test_rope_1_takes_over_what_rope_2_cannot_slacken() -> None:
    """At 3 kN the rule of halves would ask rope 2 for -500 N."""
    assert tension_commands(3000.0, Limits()) == (3200, 200)
    assert tension_commands(-3000.0, Limits()) == (200, 3200)


@given(st.floats(0, 3000), st.floats(-3, 3))
def test_a_reserve_is_kept_below_the_upper_limit(reserve: float, share: float) -> None:
    """The commands are those of a winch that is so much weaker."""
    kept = Limits(preload=4000.0, reserve=reserve)
    weaker = Limits(preload=4000.0, tension_max=6000.0 - reserve)
    u_sat = share * kept.force
    assert kept.force == pytest.approx(5800 - reserve)
    assert kept.strength == 5800
    assert tension_commands(u_sat, kept) == pytest.approx(tension_commands(u_sat, weaker))
    assert max(tension_commands(u_sat, kept)) <= 6000 - reserve
