import pytest

from dualwinch.controllers.laws.pid_cascade import PidCascade, PidCascadeState
from tests.controllers.laws.samples import step


def test_two_loops_by_hand() -> None:
    e1 = -0.01
    state, output = step(PidCascade(), PidCascadeState(), e1, 0.02)
    I1 = 1e-3 * e1
    ev = -10 * e1 - 0.1 * I1 - 0.02
    assert pytest.approx(I1) == state.I1
    assert pytest.approx(1e-3 * ev) == state.I2
    assert output.u == pytest.approx(1e4 * (2 * ev + 0.05 * 1e-3 * ev))


@pytest.mark.parametrize("x", [-1.0, 1.0])
def test_integrals_are_held_while_they_would_push_into_the_limit(x: float) -> None:
    before = PidCascadeState(I1=0.3, I2=0.2, ev_previous=0.1, primed=1.0)
    after, output = step(PidCascade(), before, x)
    held_ev = -10 * x - 0.1 * 0.3
    assert (after.I1, after.I2) == (0.3, 0.2)
    assert output.u == pytest.approx(1e4 * (2 * held_ev + 0.05 * 0.2))
    assert abs(output.u_sat) == 5800


def test_integrals_that_lead_out_of_the_limit_go_on() -> None:
    """The force is beyond its limit, yet the speed error asks for less of it."""
    before = PidCascadeState(I2=20.0, primed=1.0)
    after, output = step(PidCascade(), before, 0.0, 0.1)
    assert output.u_sat == 5800
    assert after.I2 < before.I2


def test_derivative_is_zero_at_the_first_sample_only() -> None:
    law = PidCascade(ki1=0.0, ki2=0.0, kd2=0.01)
    first, output = step(law, PidCascadeState(), -0.001)
    assert output.u == pytest.approx(1e4 * 2 * 0.01)
    _, output = step(law, first, -0.002)
    assert output.u == pytest.approx(1e4 * (2 * 0.02 + 0.01 * 0.01 / 1e-3))


def test_speed_error_weighs_in_the_position_loop() -> None:
    _, output = step(PidCascade(ki1=0.0, ki2=0.0, kd1=3.0), PidCascadeState(), 0.0, 0.05)
    assert output.u == pytest.approx(1e4 * 2 * (-3 * 0.05 - 0.05))
