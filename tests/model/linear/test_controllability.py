import numpy as np
import pytest

from dualwinch.model.linear.properties import (
    is_controllable,
    is_observable,
    mode_controllability,
    mode_observability,
    sufficient_sensors,
)
from dualwinch.model.linear.system import LinearSystem
from tests.plant_points import linearise


def test_a_mode_without_input_and_a_mode_without_output_are_found() -> None:
    units = dict.fromkeys("abuyz", "1")
    A, B = np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]])
    system = LinearSystem(
        A,
        B,
        np.array([[0.0, 3.0], [1.0, 1.0]]),
        np.zeros((2, 1)),
        dt=None,
        states=("a", "b"),
        inputs=("u",),
        outputs=("y", "z"),
        units=units,
    )
    assert list(mode_controllability(system) > 1e-12) == [True, False]
    assert list(mode_observability(system, ["y"]) > 1e-12) == [False, True]
    assert not is_controllable(system)
    assert is_observable(system, ["z"])
    assert sufficient_sensors(system) == (("z",),)


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_only_a_position_sensor_sees_where_the_vehicle_is(dt: float | None) -> None:
    system = linearise(x=10.0, v=1.8, dt=dt)
    assert sufficient_sensors(system) == (("x",),)
    assert not is_observable(system, ["v", "F1", "F2", "omega_1", "omega_2"])
    assert is_controllable(system, ["tau_1"])
    assert is_controllable(system, ["tau_2"])


def test_in_the_middle_of_the_track_the_position_hides_what_opposed_drums_do() -> None:
    """Equal ropes pull equally and against each other: the vehicle stays where it is."""
    assert sufficient_sensors(linearise(x=25.0)) == (("x", "F1"), ("x", "F2"), ("x", "omega_1"), ("x", "omega_2"))


def test_units_do_not_matter() -> None:
    system = linearise(x=10.0, v=1.0)
    state, into, out = np.array([1e3, 1e3, 60.0, 10.0, 60.0, 10.0]), np.array([10.0, 0.1, 5.0, 2.0]), np.full(6, 1e3)
    other = LinearSystem(
        state[:, None] * system.A / state,
        state[:, None] * system.B / into,
        out[:, None] * system.C / state,
        system.D,
        dt=None,
        states=system.states,
        inputs=system.inputs,
        outputs=system.outputs,
        units=system.units,
    )
    order, other_order = np.argsort(system.poles()), np.argsort(other.poles())
    mine, theirs = mode_observability(system, ["F1", "x"])[order], mode_observability(other, ["F1", "x"])[other_order]
    np.testing.assert_allclose(theirs, mine, rtol=0.5)  # balanced by powers of two
