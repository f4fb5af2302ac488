from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dualwinch.model.reference import Reference, setpoint, steady_window
from tests.oracle.sampled import profile, uniform
from tests.tolerances import close

PROFILE, UNIFORM = Reference(kind="profile"), Reference(kind="uniform")


def values(t: float, reference: Reference) -> tuple[float, float, float]:
    point = setpoint(t, reference)
    return point.x, point.v, point.a


@given(st.floats(0, 50))
def test_profile_is_the_papers_with_the_repaired_cruise(t: float) -> None:
    assert values(t, PROFILE) == pytest.approx(profile(t), abs=1e-12)


@given(st.floats(0, 25))
def test_uniform(t: float) -> None:
    assert values(t, UNIFORM) == pytest.approx(uniform(t))


@pytest.mark.parametrize(("joint", "acceleration"), [(18.0, 0.1), (29.0, 0.0), (41.0, -0.15)])
def test_the_piece_before_a_joint_holds_at_the_joint(joint: float, acceleration: float) -> None:
    assert setpoint(joint, PROFILE).a == pytest.approx(acceleration)


@given(
    st.floats(0.1, 2),
    st.tuples(st.floats(1, 20), st.floats(0, 20), st.floats(1, 20)),
    st.floats(0.01, 0.99),
)
def test_speed_and_acceleration_are_the_derivatives(
    speed: float, spans: tuple[float, float, float], share: float
) -> None:
    first, second, third = spans[0], spans[0] + spans[1], sum(spans)
    reference = Reference("profile", speed, first, second, third)
    t, h = share * third, 1e-5
    assume(min(abs(t - joint) for joint in (first, second, third)) > 2 * h)
    before, now, after = (values(t + shift, reference) for shift in (-h, 0, h))
    assert now[1] == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-7)
    assert now[2] == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-7)


def test_another_cruise_speed_scales_the_whole_motion() -> None:
    half = replace(PROFILE, speed=0.9)
    for t in (5.0, 20.0, 35.0, 45.0):
        assert values(t, half) == pytest.approx([value / 2 for value in values(t, PROFILE)])


def test_steady_state_is_the_constant_speed_phase() -> None:
    assert steady_window(PROFILE, 50.0) == (18.0, 29.0)
    assert steady_window(UNIFORM, 25.0) == (20.0, 25.0)


JERKS = (0.06, 0.2, 1.0, 100.0)
"""Limits in m/s^3; the profile needs 0.05 to brake in time."""


@pytest.mark.parametrize("jerk", JERKS)
@pytest.mark.parametrize("reference", [PROFILE, UNIFORM])
def test_jerk_is_bounded_and_everything_else_continuous(reference: Reference, jerk: float) -> None:
    t = np.linspace(0, 50, 500_001)
    point = setpoint(t, replace(reference, jerk_limit=jerk))
    h = t[1]
    assert np.abs(np.diff(point.a)).max() <= jerk * h * (1 + 1e-6)
    assert np.abs(np.diff(point.a)).max() >= 0.99 * min(jerk * h, 0.1)
    assert close(np.diff(point.v), h * (point.a[1:] + point.a[:-1]) / 2, abs=jerk * h**2)
    assert close(np.diff(point.x), h * (point.v[1:] + point.v[:-1]) / 2, abs=1e-12 + jerk * h**3)
    assert (point.x[0], point.v[0], point.a[0]) == (0, 0, 0)


@given(st.sampled_from(JERKS), st.floats(18, 29, exclude_min=True) | st.floats(41, 50, exclude_min=True))
def test_cruise_and_end_stay_the_papers(jerk: float, t: float) -> None:
    assert values(t, replace(PROFILE, jerk_limit=jerk)) == pytest.approx(values(t, PROFILE), abs=1e-12)


def test_a_high_limit_is_no_limit() -> None:
    for t in (0.5, 5.0, 17.0, 30.0, 40.0):
        assert values(t, replace(PROFILE, jerk_limit=1e6)) == pytest.approx(values(t, PROFILE), abs=1e-5)


def test_uniform_reaches_its_speed_in_the_shortest_time() -> None:
    """Half the rise and half the fall of a triangle of acceleration: 1.5 m/s at 1.5 m/s^3 in 2 s, 1.5 m behind."""
    limited = replace(UNIFORM, jerk_limit=1.5)
    assert values(1.0, limited) == pytest.approx((0.25, 0.75, 1.5))
    assert values(2.0, limited) == pytest.approx((1.5, 1.5, 0.0), abs=1e-7)
    assert values(10.0, limited) == pytest.approx((13.5, 1.5, 0.0))


def test_symbols_floats_and_arrays_agree() -> None:
    t, jerk = ca.SX.sym("t"), ca.SX.sym("jerk")
    point = setpoint(t, replace(PROFILE, jerk_limit=jerk))
    function = ca.Function("setpoint", [t, jerk], [point.x, point.v, point.a])
    times = np.linspace(0.05, 49.95, 500)
    array = setpoint(times, replace(PROFILE, jerk_limit=0.2))
    for k, time in enumerate(times):
        expected = values(time, replace(PROFILE, jerk_limit=0.2))
        assert [float(value) for value in function(time, 0.2)] == pytest.approx(expected, abs=1e-12)
        assert (array.x[k], array.v[k], array.a[k]) == pytest.approx(expected, abs=1e-12)
