import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.ropes import Track
from dualwinch.model.vehicle import Vehicle, drag, friction, inertia, slope_force

VEHICLE = Vehicle()
speeds = st.floats(-5, 5)


@given(speeds)
def test_friction_and_drag_are_odd(v: float) -> None:
    assert friction(-v, VEHICLE) == pytest.approx(-friction(v, VEHICLE))
    assert drag(-v, VEHICLE) == pytest.approx(-drag(v, VEHICLE))


def test_numbers_at_cruise_speed() -> None:
    assert friction(1.8, VEHICLE) == pytest.approx(490)
    assert drag(1.8, VEHICLE) == pytest.approx(0.5 * 0.3 * 1000 * 6 * 1.8**2)


def test_a_current_across_the_track_adds_to_the_flow() -> None:
    """3 m/s along and 4 m/s across are a flow of 5 m/s, of whose drag 3/5 act along the track."""
    crossed = replace(VEHICLE, cross_current=4.0)
    assert drag(3.0, crossed) == pytest.approx(0.5 * 0.3 * 1000 * 6 * 5**2 * 3 / 5)
    assert drag(0.0, crossed) == 0


@given(speeds, st.floats(-4000, 4000))
def test_rail_load_scales_the_friction(v: float, load: float) -> None:
    share = (4900 + load) / 4900
    assert friction(v, VEHICLE, load) == pytest.approx(share * friction(v, VEHICLE), rel=1e-9, abs=1e-9)


def test_added_mass_is_accelerated_too() -> None:
    assert inertia(replace(VEHICLE, added_mass=9.4e3)) == 1.94e4


@pytest.mark.parametrize("v", [0.003, 0.01, 0.03, 0.1, 1.8])
def test_friction_is_stribecks_curve(v: float) -> None:
    sticky = replace(VEHICLE, stiction=0.5, stribeck_velocity=0.02, friction_velocity=1e-5)
    assert friction(v, sticky) == pytest.approx(490 * (1 + 0.5 * math.exp(-((v / 0.02) ** 2))))


@pytest.mark.parametrize("x", [0.0, 2.5, 7.5, 33.0])
def test_the_weight_that_buoyancy_leaves_acts_down_the_slope(x: float) -> None:
    """The vehicle of 10 t weighs 98 kN and displaces 93.2 kN of water: 4.9 kN on the rail, 4.9 N a milliradian."""
    track = Track(tilt=1e-3, waviness=2e-3, wavelength=10.0)
    angle = 1e-3 + 2e-3 * math.sin(2 * math.pi * x / 10)
    assert slope_force(x, VEHICLE, track) == pytest.approx(4900 * math.sin(angle), rel=1e-5)
