import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.coordinations.differential_tension import TensionLoops
from dualwinch.controllers.coordinations.force_position import ForcePosition
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, CoordinationOutput, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint

LEVER = 0.8 / 36


def step(u_sat: float, F1: float, F2: float) -> tuple[TensionLoops, CoordinationOutput]:
    estimate, context = Estimate(0.0, 0.0, F1, F2, 0.0, 0.0, 0.0, 0.0), Context(Plant(), Limits(), 1e-3)
    return ForcePosition().step(TensionLoops(), u_sat, estimate, Setpoint(0.0, 0.0, 0.0), context)


@given(st.floats(100, 5000), st.floats(0, 6000))
def test_the_winch_in_front_is_not_fed_back_its_tension(u_sat: float, tension: float) -> None:
    state, output = step(u_sat, tension, 900.0)
    assert output.tau_1 == pytest.approx(LEVER * (1000 + u_sat))
    assert output.tau_2 == pytest.approx(LEVER * 1000 + 5e-4 * 100 + 2e-2 * 0.1)
    assert (state.winch_1.integral, state.winch_2.integral) == pytest.approx((0, 0.1))


@given(st.floats(100, 5000))
def test_a_reversal_changes_the_roles(u_sat: float) -> None:
    (_, forth), (_, back) = step(u_sat, 1500.0, 900.0), step(-u_sat, 900.0, 1500.0)
    assert (forth.tau_1, forth.tau_2) == pytest.approx((back.tau_2, back.tau_1))


def test_what_the_front_cannot_give_the_rear_gives_up() -> None:
    _, output = step(5500.0, 3000.0, 1000.0)
    assert (output.F1_cmd, output.F2_cmd) == (6000, 500)


@given(st.floats(-120, 120), st.floats(0, 0.1))
def test_the_hand_over_is_continuous(u_sat: float, more: float) -> None:
    (_, before), (_, after) = step(u_sat, 1300.0, 800.0), step(u_sat + more, 1300.0, 800.0)
    for torque, other in ((before.tau_1, after.tau_1), (before.tau_2, after.tau_2)):
        assert torque == pytest.approx(other, abs=0.03 * more + 1e-9)
