"""Overloads: their events on floats, and a loop without them that has no code for them."""

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.model.actuators import Demand, Motor, MotorState, WarmMotorState
from dualwinch.model.overloads import Dropout, Payload, Push, loaded_vehicle, push_force, remaining_torque
from dualwinch.model.vehicle import Vehicle

TIMES = (19.999, 20.0, 20.099, 20.1)


def test_each_acts_from_its_start_on_for_its_duration() -> None:
    push, dropout = Push(force=-8e3, duration=0.1), Dropout(share=0.75)
    assert [push_force(t, push) for t in TIMES] == [0, -8e3, -8e3, 0]
    assert [remaining_torque(t, 40.0, dropout) for t in TIMES] == [40, 10, 10, 40]
    loads = [loaded_vehicle(t, Vehicle(), Payload(mass=0.25, drag=0.5)) for t in TIMES]
    assert [(load.mass, load.drag_coefficient) for load in loads] == [(1e4, 0.3)] + 3 * [(1.25e4, pytest.approx(0.45))]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_motor_has_constant_torque_up_to_its_base_speed_and_constant_power_above(sign: float) -> None:
    motor, speeds = Motor(time_constant=1e-6, torque_limit=100.0, base_speed=60.0), np.array([0.0, 59.0, 61.0, 240.0])
    reached = [
        sign * motor.step(MotorState(0.0), Demand(sign * 150.0, 0.0, float(speed)), 1e-3)[0].torque
        for speed in (*speeds, *-speeds)
    ]
    assert reached == pytest.approx(2 * [100.0, 100.0, 100 * 60 / 61, 25.0])
    assert Motor(torque_limit=100.0).available(Demand(-150.0, 0.0, 1e3)) == -100
    assert motor.available(Demand(20.0, 0.0, 240.0)) == 20


def test_a_push_does_what_a_given_force_does() -> None:
    times, forces = [0.0, 5.0, 5.3, 20.0], [0.0, -2e3, 0.0, 0.0]
    given = {"times": times, "values": forces, "unit": "N", "interpolation": "previous"}
    short = dw.override(dw.case(4), {"simulation.duration": 8.0})
    pushed = dw.override(short, {"disturbance.push.force": -2e3, "disturbance.push.start": 5.0})
    pushed = dw.override(pushed, {"disturbance.push.duration": 0.3})
    expected = dw.simulate(dw.override(short, {f"disturbance.force.{key}": value for key, value in given.items()}))
    result = dw.simulate(pushed)
    np.testing.assert_allclose(result["x"], expected["x"], rtol=1e-12)
    assert np.abs(result["e"]).max() > 5 * np.abs(dw.simulate(short)["e"]).max()


def test_recovery_is_the_longest_time_off_the_reference() -> None:
    pushed = dw.override(dw.case(4), {"disturbance.push.force": -6e3, "simulation.duration": 30.0})
    result = dw.simulate(dw.override(pushed, {"metrics": ["recovery"], "metrics.recovery.tolerance": 0.02}))
    beyond = np.abs(result["e"]) > 0.02
    ends = np.flatnonzero(np.diff(np.concatenate([[0], beyond, [0]]).astype(int)))
    assert result.metrics["recovery"] == pytest.approx(np.diff(ends)[::2].max() * 1e-3)
    assert result.metrics["recovery"] > 0.3


def test_a_hot_motor_gives_its_continuous_torque_until_it_has_cooled() -> None:
    """At twice the continuous torque the heat reaches one after T ln(4/3); at none it fades exponentially."""
    motor, step = Motor(time_constant=1e-4, torque_limit=200.0, continuous_torque=60.0, thermal_time=10.0), 0.01
    state, torques, heats = motor.initial_state(), [], []
    for number in range(1000):
        state, torque = motor.step(state, Demand(120.0 if number < 800 else 0.0, 0.0, 0.0), step)
        torques.append(torque)
        assert isinstance(state, WarmMotorState)
        heats.append(state.heat)
    hot = next(number for number, torque in enumerate(torques) if torque < 100 and number > 0)
    assert hot * step == pytest.approx(10.0 * np.log(4 / 3), abs=3 * step)
    assert torques[hot + 1 : 800] == pytest.approx([60.0] * (799 - hot))
    assert heats[-1] == pytest.approx(np.exp(-2.0 / 10.0), rel=0.01)
    _, again = motor.step(state, Demand(120.0, 0.0, 0.0), step)
    assert again > 100.0
    held = motor.holding_state(30.0)
    assert isinstance(held, WarmMotorState)
    assert held.heat == pytest.approx(0.25)
