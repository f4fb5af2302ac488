from dataclasses import replace
from inspect import unwrap
from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.coordinations.differential_tension import tension_commands
from dualwinch.controllers.limits import Limits
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import operating_points, shared_tensions
from dualwinch.model.plant import Plant, holding_torques, resting_state
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.ropes import Track
from tests.oracle.plant import Hold
from tests.oracle.plant import Plant as OraclePlant
from tests.oracle.values import DEFAULTS
from tests.plant_points import linearise, operating_point

CHANGED = DEFAULTS | {
    "plant.vehicle.added_mass": 3e3,
    "plant.vehicle.friction_velocity": 0.02,
    "plant.rope_1.modulus": 60e9,
    "plant.rope_2.damping": 2500.0,
    "plant.winch_1.drum_radius": 0.7,
    "plant.winch_2.inertia": 2.5,
    "plant.winch_1.coulomb_friction": 40.0,
    "plant.winch_2.viscous_friction": 3.0,
}


def test_at_rest_it_is_the_initial_state_of_a_run() -> None:
    point = operating_point(0.0, 0.0, 3000.0)
    assert point.state == pytest.approx(resting_state(3000.0, Plant()))
    assert point.torques == pytest.approx(holding_torques(3000.0, Plant()))
    assert (point.F1, point.F2) == (1500.0, 1500.0)
    assert point.violations == point.remarks == ()
    assert operating_point(plant=Plant(track=Track(length=120.0))).x == 60.0, "amid the track"


@pytest.mark.parametrize("values", [DEFAULTS, CHANGED], ids=["paper", "changed"])
@pytest.mark.parametrize(("x", "v", "preload"), [(3.0, 1.8, 2000.0), (40.0, -2.0, 6000.0), (10.0, 0.3, 900.0)])
def test_a_cruise_goes_on_for_seconds_without_any_acceleration(
    values: dict[str, float], x: float, v: float, preload: float
) -> None:
    """In the independent plant, along the whole motion: constant tensions, no acceleration."""
    point = operating_point(x, v, preload, with_leaves(Plant(), values, "plant."), current=0.1)
    oracle = OraclePlant(values)
    speed = (v, point.omega_1, point.omega_2)
    for t in (0.0, 2.0, 10.0):
        position = (x + v * t, point.theta_1 + point.omega_1 * t, point.theta_2 + point.omega_2 * t)
        hold = Hold(point.tau_1, point.tau_2, current=0.1)
        accelerations, _ = oracle.motion(t, position, speed, hold, oracle.taut(position, speed))
        np.testing.assert_allclose(accelerations, 0.0, atol=1e-6)
        np.testing.assert_allclose(oracle.tensions(position, speed), (point.F1, point.F2), rtol=1e-9)
    assert point.residual < 1e-6
    assert point.tension_rate < 1e-3


def test_the_residual_sees_a_wrong_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """With drums as fast as the vehicle, the tension is off by what damps the stretch, and grows."""
    from dualwinch.model.linear import operating_point as module
    from dualwinch.model.linear.operating_point import steady_motion

    def same_speed(x: float, v: float, tensions: tuple[float, float], plant: Plant) -> object:
        cruise = steady_motion(x, v, tensions, plant)
        omega = v / plant.winch_1.drum_radius
        return cruise._replace(state=replace(cruise.state, omega_1=omega, omega_2=-omega))

    monkeypatch.setattr(module, "operating_point_law", unwrap(module.operating_point_law))  # builds anew
    monkeypatch.setattr(module, "steady_motion", same_speed)
    point = operating_point(25.0, 1.8)
    rise, excess = point.F1 * 1.8 / 25.5, 1000 * point.F1 * 1.8 / (80e9 * 4.52e-4 - 1800)
    assert point.residual == pytest.approx(excess * 0.8**2 / 1.8, rel=1e-3)
    assert point.tension_rate == pytest.approx(rise - 1000 * excess * 0.8**2 / 1.8, rel=1e-3)


@given(net=st.floats(-5800, 5800), preload=st.floats(401, 11999))
def test_tensions_are_shared_as_the_controller_shares_them(net: float, preload: float) -> None:
    expected = tension_commands(net, Limits(preload=preload))
    found = [float(force) for force in shared_tensions(net, preload, 200.0, 6000.0)]
    assert found == pytest.approx(expected, abs=1e-9)


def test_limits_that_are_passed_are_named() -> None:
    (violation,) = operating_point(25.0, 2.5).violations
    assert violation == "cruise at 2.5 m/s needs 6 315 N in rope 1 > tension_max = 6 000 N"
    (remark,) = operating_point(25.0, 1.8).remarks
    assert remark == "a rope is at its limit: the tensions' sum is 3 806 N, not the preload's 2 000 N"
    (violation,) = operating_point(25.0, -1.8, plant=with_leaves(Plant(), CHANGED, "plant.")).violations
    assert violation.startswith("cruise at -1.8 m/s needs tau_1 = ")
    assert violation.endswith(" N m < 3.889 N m, the torque of tension_min")


def test_a_slack_rope_is_reported_and_has_no_linearisation() -> None:
    point = operating_point(25.0, 1.8, tension_min=0.0)
    assert (point.slack_1, point.slack_2) == (False, True)
    assert point.F2 == 0.0
    with pytest.raises(ConfigurationError, match=r"^rope 2 is slack at x = 25 m, v = 1.8 m/s: .*tension_min > 0"):
        linearise(x=25.0, v=1.8, tension_min=0.0)


SHORT = Plant(track=Track(rope_offset=0.06))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x": 50.3}, r"x = 50.3: must be a finite number >= -0.25 and <= 50.25 m \(the track"),
        ({"x": nan}, "x = nan: must be a finite number"),
        ({"x": -0.02, "plant": SHORT}, "x = -0.02: leaves 0.04 m of rope 2, must be > 0.05 m"),
        ({"x": 50.02, "plant": SHORT}, "x = 50.02: leaves 0.04 m of rope 1"),
        ({"v": 12.0}, "v = 12: must be a finite number >= -10 and <= 10 m/s"),
        ({"v": nan}, "v = nan"),
        ({"preload": 400.0}, "preload = 400: must be a finite number > 400 and < 12000 N"),
        ({"tension_min": -1.0}, "tension_min = -1: must be a finite number >= 0 N"),
        ({"tension_max": 100.0}, "tension_max = 100: must be a finite number >= 200 N"),
        ({"current": nan}, "current = nan"),
        ({"force": nan}, "force = nan: must be a finite number N"),
    ],
)
def test_bad_input_is_one_clear_line(arguments: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match="^" + message) as caught:
        operating_point(**arguments)
    assert "\n" not in str(caught.value)


def test_many_points_are_the_same_as_one_by_one() -> None:
    x, v = np.array([1.0, 20.0, 44.0]), np.array([0.5, 0.0, -1.0])
    points = operating_points(x, v, 2500.0, Plant())
    assert points == [operating_point(*pair, 2500.0) for pair in zip(x, v, strict=True)]
