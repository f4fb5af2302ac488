"""Rope on drums against integrals of the radius, by quadrature."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import Creep, crept
from dualwinch.model.winch import Winch, angle_of, shaft_torque, specified_winch, winding

drums = st.builds(
    Winch,
    drum_radius=st.floats(0.1, 2),
    radius_error=st.floats(-0.01, 0.01),
    layer_thickness=st.floats(0, 0.04),
    layer_laps=st.floats(4, 40),
    eccentricity=st.floats(0, 0.005),
    eccentricity_angle=st.floats(-4, 4),
)
angles = st.floats(-60, 60)


def radius(theta: float, winch: Winch) -> float:
    """As `model.winch` says it in words."""
    spiral = winch.layer_thickness / winch.layer_laps * theta / (2 * math.pi)
    return (
        winch.drum_radius * (1 + winch.radius_error)
        + spiral
        + winch.eccentricity * math.cos(theta + winch.eccentricity_angle)
    )


@given(drums, angles)
def test_the_rope_is_the_integral_of_the_radius(winch: Winch, theta: float) -> None:
    here = winding(theta, winch)
    assert here.radius == pytest.approx(radius(theta, winch), rel=1e-12)
    integral = quad(radius, 0.0, theta, (winch,), limit=500, epsabs=1e-12)[0]
    assert here.rope == pytest.approx(integral, abs=1e-10)


@given(drums, angles, st.floats(-2e-3, 2e-3))
def test_around_an_angle_it_is_a_series(winch: Winch, theta: float, turn: float) -> None:
    here, there = winding(theta, winch), winding(theta + turn, winch)
    assert here.radius_after(turn) == pytest.approx(there.radius, abs=1e-11)
    assert here.base * (theta + turn) + here.beyond_of(there.rope) == pytest.approx(there.rope, abs=1e-11)


@given(drums, angles)
def test_so_much_rope_is_wound_at_that_angle(winch: Winch, theta: float) -> None:
    assert angle_of(winding(theta, winch).rope, winch) == pytest.approx(theta, abs=1e-9)


@given(angles)
def test_a_true_drum_of_one_layer_is_its_radius(theta: float) -> None:
    here = winding(theta, Winch())
    assert here.rope == 0.8 * theta
    assert here.radius == here.radius_after(0.1) == 0.8
    assert angle_of(0.8 * theta, Winch()) == 0.8 * theta / 0.8


def test_a_rope_creeps_to_its_last_length() -> None:
    creep = Creep(elongation=1e-3, time=20.0)
    assert crept(0.0, creep) == (0.0, 1e-3 / 20)
    assert crept(20.0, creep)[0] == pytest.approx(1e-3 * (1 - math.exp(-1)))
    assert crept(1e4, creep) == pytest.approx((1e-3, 0.0))


def test_a_motor_gives_its_error_and_its_ripple() -> None:
    winch = Winch(torque_error=0.02, torque_ripple=0.01, ripple_waves=6, ripple_angle=math.pi / 2)
    assert shaft_torque(10.0, 0.0, winch) == pytest.approx(10.3)
    half_a_wave = math.pi / (6 * winch.gear_ratio)
    assert shaft_torque(10.0, half_a_wave, winch) == pytest.approx(10.1)


def test_a_data_sheet_knows_layers_and_nothing_of_errors() -> None:
    real = Winch(drum_radius=0.7, layer_thickness=0.02, radius_error=0.01, eccentricity=1e-3, torque_ripple=0.1)
    assert specified_winch(replace(real, torque_error=0.1)) == Winch(drum_radius=0.7, layer_thickness=0.02)


def test_all_that_is_unknown_of_a_winch_is_off_in_its_data_sheet() -> None:
    """The marks beside the fields and the data sheet's winch say the same."""
    unknown = {key for key, leaf in describe(Winch).items() if leaf.marks >= {Mark.UNKNOWN, Mark.OFF_AT_ZERO}}
    off = leaves(specified_winch(Winch(**dict.fromkeys(unknown, 0.05))))
    assert unknown
    assert {off[key] for key in unknown} == {0.0}
