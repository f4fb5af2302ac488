from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.winch import Winch, drum_acceleration, friction_torque

ROUGH = replace(Winch(), coulomb_friction=30.0, viscous_friction=4.0)


@given(st.floats(-100, 100))
def test_friction_opposes_the_drum(omega: float) -> None:
    assert friction_torque(omega, ROUGH) * omega >= 0


def test_friction_far_from_rest() -> None:
    assert friction_torque(2.0, ROUGH) == pytest.approx(38)
    assert friction_torque(-2.0, ROUGH) == pytest.approx(-38)


@given(st.floats(0, 8000))
def test_motor_torque_radius_over_ratio_times_tension_holds_the_drum(force: float) -> None:
    assert drum_acceleration(0.0, force, 0.8 / 36 * force, Winch()) == pytest.approx(0, abs=1e-9)


def test_gearbox_multiplies_the_torque() -> None:
    assert drum_acceleration(0.0, 0.0, 1.0, Winch()) == pytest.approx(20)
