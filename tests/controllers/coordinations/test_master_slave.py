from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.coordinations.master_slave import MasterSlave, MasterSlaveState
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, CoordinationOutput, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.winch import Winch

LEVER = 0.8 / 36
CRUISING = Estimate(10.0, 1.6, 2000.0, 900.0, 2.0, -2.0, 0.0, 0.0)
POINT = Setpoint(10.0, 1.6, 0.0)


def step(
    u_sat: float,
    estimate: Estimate = CRUISING,
    setpoint: Setpoint = POINT,
    state: MasterSlaveState | None = None,
    plant: Plant | None = None,
) -> tuple[MasterSlaveState, CoordinationOutput]:
    before, context = state or MasterSlaveState(), Context(plant or Plant(), Limits(), 1e-3)
    return MasterSlave().step(before, u_sat, estimate, setpoint, context)


def test_in_step_only_the_feedforwards_act() -> None:
    state, output = step(1000.0)
    assert (output.tau_1, output.tau_2) == pytest.approx((LEVER * 2000, LEVER * 1000))
    assert state.angle == pytest.approx(0)


def test_reference_acceleration_turns_the_drums_in_opposite_directions() -> None:
    _, output = step(1000.0, setpoint=replace(POINT, a=0.4))
    assert (output.tau_1, output.tau_2) == pytest.approx((LEVER * 2000 + 1.8 / 36 * 0.5, LEVER * 1000 - 1.8 / 36 * 0.5))


def test_the_master_hurries_after_a_vehicle_that_is_behind() -> None:
    state, output = step(1000.0, estimate=replace(CRUISING, x=9.6))
    assert state.angle == pytest.approx(1e-3 * 0.5)
    assert output.tau_1 == pytest.approx(LEVER * 2000 + 5 * 0.5 + 10 * 1e-3 * 0.5)
    assert output.tau_2 == pytest.approx(LEVER * 1000)


def test_the_slave_pays_out_as_fast_as_the_master_hauls_in() -> None:
    small = Plant(winch_2=Winch(drum_radius=0.4))
    _, in_step = step(1000.0, estimate=replace(CRUISING, omega_2=-4.0), plant=small)
    _, too_slow = step(1000.0, estimate=replace(CRUISING, omega_2=-3.0), plant=small)
    assert in_step.tau_2 == pytest.approx(LEVER / 2 * 1000)
    assert too_slow.tau_2 == pytest.approx(LEVER / 2 * 1000 - 5)


@given(st.floats(0, 6000), st.floats(0, 6000))
def test_no_tension_is_fed_back(F1: float, F2: float) -> None:
    assert step(1000.0, estimate=replace(CRUISING, F1=F1, F2=F2)) == step(1000.0)


def test_the_integral_is_held_at_the_torque_limit() -> None:
    state, output = step(5800.0, estimate=replace(CRUISING, omega_1=0.0), state=MasterSlaveState(0.2))
    assert output.tau_1 == pytest.approx(LEVER * 6000)
    assert output.torque_saturated
    assert state.angle == 0.2
