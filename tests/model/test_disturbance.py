from math import pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.vehicle import Vehicle, drag
from tests.oracle.plant import Hold, Plant
from tests.oracle.values import DEFAULTS

VEHICLE = Vehicle()
ON = Disturbance(vortex=True)
INTEGRATED = Disturbance(vortex=True, integrated_phase=True)
times, speeds = st.floats(0, 50), st.floats(-3, 3)


@given(times, speeds)
def test_the_papers_force(t: float, v: float) -> None:
    expected = 0.2 * drag(v, VEHICLE) * sin(2 * pi * 0.2 * v / 2 * t)
    assert vortex_force(t, v, 0.0, ON, VEHICLE) == pytest.approx(expected, abs=1e-9)


@given(times, speeds, st.floats(0, 50))
def test_the_force_with_the_frequency_integrated(t: float, v: float, way: float) -> None:
    """A vehicle that has gone a way has shed strouhal/diameter vortices a metre, at whatever speed."""
    phase = 2 * pi * 0.2 / 2 * way
    expected = 0.2 * drag(v, VEHICLE) * sin(phase)
    assert vortex_force(t, v, phase, INTEGRATED, VEHICLE) == pytest.approx(expected, abs=1e-9)


@given(times, speeds)
def test_force_stays_below_its_share_of_the_drag(t: float, v: float) -> None:
    assert abs(vortex_force(t, v, 0.0, ON, VEHICLE)) <= 0.2 * abs(drag(v, VEHICLE)) + 1e-12


def test_off_by_default() -> None:
    assert vortex_force(3.0, 1.5, 1.0, Disturbance(), VEHICLE) == 0


def test_strouhal_frequency() -> None:
    assert vortex_frequency(1.5, ON, VEHICLE) == pytest.approx(2 * pi * 0.15)


@given(times, st.floats(0, 50), speeds)
def test_the_independent_plant_feels_the_same_force(t: float, x: float, v: float) -> None:
    hold, taut, position, speed = Hold(0.0, 0.0), (False, False), (x, 0.0, 0.0), (v, 0.0, 0.0)
    for phase, integrated in ((0.0, False), (2 * pi * 0.1 * x, True)):
        values = {**DEFAULTS, "disturbance.vortex": True, "disturbance.integrated_phase": integrated}
        with_vortex = Plant(values).motion(t, position, speed, hold, taut)[0][0]
        without = Plant(DEFAULTS).motion(t, position, speed, hold, taut)[0][0]
        disturbance = Disturbance(vortex=True, integrated_phase=integrated)
        force = vortex_force(t, v, phase, disturbance, VEHICLE)
        assert 1e4 * (with_vortex - without) == pytest.approx(force, abs=1e-8)
