"""Way-points: reached exactly, within all limits, in the least time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from dualwinch.model.reference import Reference, own_duration, setpoint, steady_window
from tests.tolerances import close

POINTS = st.lists(st.floats(0.01, 50), min_size=1, max_size=4)


def reference(points, pauses=(), speed=1.8, acceleration=0.1, jerk: float | None = 0.2) -> Reference:
    return Reference(
        "way-points", speed, points=tuple(points), pauses=pauses, acceleration=acceleration, jerk_limit=jerk
    )


@given(POINTS, st.floats(0.1, 3), st.floats(0.05, 2), st.floats(0.05, 5) | st.none())
def test_limits_are_kept_and_everything_is_the_derivative_of_the_next(
    points: list[float], speed: float, acceleration: float, jerk: float | None
) -> None:
    asked = reference(points, (), speed, acceleration, jerk)
    t = np.linspace(0, own_duration(asked), 20_001)
    h, found = t[1], setpoint(t, asked)
    assert np.abs(found.v).max() <= speed * (1 + 1e-9)
    assert np.abs(found.a).max() <= acceleration * (1 + 1e-6)
    if jerk is not None:
        assert np.abs(np.diff(found.a)).max() <= jerk * h * (1 + 1e-6) + 1e-7
        assert close(np.diff(found.v), h * (found.a[1:] + found.a[:-1]) / 2, abs=2 * jerk * h**2 + 1e-9)
    assert close(np.diff(found.x), h * (found.v[1:] + found.v[:-1]) / 2, abs=2 * acceleration * h**2 + 1e-9)
    assert (found.x[0], found.v[0], found.v[-1]) == pytest.approx((0, 0, 0), abs=1e-9)
    assert found.x[-1] == pytest.approx(points[-1], abs=1e-12)


def test_points_are_reached_and_rested_at() -> None:
    asked = reference((20.0, 5.0, 5.0, 40.0), (2.0, 0.0, 1.0, 3.0))
    first, second, third = asked.moves
    assert second.begin == first.finish + 2
    assert third.begin == second.finish + 1
    assert own_duration(asked) == third.finish + 3
    for move, point in zip(asked.moves, (20.0, 5.0, 40.0), strict=True):
        for t in (move.finish, move.finish + 0.5):
            now = setpoint(t, asked)
            if move is not second or t == move.finish:
                assert (now.x, now.v, now.a) == pytest.approx((point, 0, 0), abs=1e-12)
    assert setpoint(1000.0, asked).x == 40.0


def test_a_long_way_in_closed_form() -> None:
    """A + V/A + A/J seconds each: 20 m at 2 m/s, 0.5 m/s^2, 0.5 m/s^3 take 20/2 + 2/0.5 + 0.5/0.5 = 15 s."""
    asked = reference((20.0,), (), 2.0, 0.5, 0.5)
    assert own_duration(asked) == pytest.approx(15.0)
    assert steady_window(asked, 15.0) == pytest.approx((5.0, 10.0))
    assert setpoint(5.0, asked).x == pytest.approx(5.0)
    trapezium = reference((20.0,), (), 2.0, 0.5, None)
    assert own_duration(trapezium) == pytest.approx(14.0)


def test_short_ways_have_no_cruise_and_shorter_ones_no_constant_acceleration() -> None:
    medium, short = reference((10.0,), (), 100.0, 0.5, 0.5), reference((0.25,), (), 100.0, 0.5, 0.5)
    stepping = reference((4.0, 1.0), (), 1.8, 0.5, None)
    for asked in (medium, short, stepping):
        assert steady_window(asked, own_duration(asked)) == (0.0, own_duration(asked))
    assert own_duration(short) == pytest.approx(4 * (0.25 / (2 * 0.5)) ** (1 / 3))  # four ramps of jerk, 2 J T^3 = D
    t = np.linspace(0, own_duration(short), 10_001)
    assert np.abs(setpoint(t, short).a).max() < 0.5


@pytest.mark.parametrize(("distance", "speed"), [(20.0, 2.0), (10.0, 100.0), (0.25, 100.0), (3.0, 0.7)])
def test_no_motion_within_the_limits_is_faster(distance: float, speed: float) -> None:
    """Against a linear programme over jerks: the farthest way in the time taken is the distance, within its grid."""
    acceleration, jerk, n = 0.5, 0.5, 200
    h = own_duration(reference((distance,), (), speed, acceleration, jerk)) / n
    k = np.arange(n)
    to_a = h * np.tri(n)
    to_v = h**2 * np.where(k[:, None] >= k, k[:, None] - k + 0.5, 0.0)
    to_x = h**3 * ((n - k) ** 2 / 2 - (n - k) / 2 + 1 / 6)
    found = linprog(
        -to_x,
        A_ub=np.vstack([to_a, -to_a, to_v]),
        b_ub=np.concatenate([np.full(2 * n, acceleration), np.full(n, speed)]),
        A_eq=np.vstack([to_a[-1], to_v[-1]]),
        b_eq=[0.0, 0.0],
        bounds=(-jerk, jerk),
    )
    assert -found.fun == pytest.approx(distance, rel=2e-3)
    assert -found.fun <= distance * (1 + 1e-9)
