from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.vehicle import Vehicle, drag, friction, inertia

VEHICLE = Vehicle()
speeds = st.floats(-5, 5)


@given(speeds)
def test_friction_and_drag_are_odd(v: float) -> None:
    assert friction(-v, VEHICLE) == pytest.approx(-friction(v, VEHICLE))
    assert drag(-v, VEHICLE) == pytest.approx(-drag(v, VEHICLE))


def test_numbers_at_cruise_speed() -> None:
    assert friction(1.8, VEHICLE) == pytest.approx(490)
    assert drag(1.8, VEHICLE) == pytest.approx(0.5 * 0.3 * 1000 * 6 * 1.8**2)


@given(speeds, st.floats(-4000, 4000))
def test_rail_load_scales_the_friction(v: float, load: float) -> None:
    share = (4900 + load) / 4900
    assert friction(v, VEHICLE, load) == pytest.approx(share * friction(v, VEHICLE), rel=1e-9, abs=1e-9)


def test_added_mass_is_accelerated_too() -> None:
    assert inertia(replace(VEHICLE, added_mass=9.4e3)) == 1.94e4
