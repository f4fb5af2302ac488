from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from model.reference import Reference, setpoint, steady_window
from tests.oracle.sampled import profile, uniform

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
