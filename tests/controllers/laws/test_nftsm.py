import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains, odd_power
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.vehicle import Vehicle

numbers = st.floats(-10, 10)


def control(x: float, v: float, Z_a: float = 0.0, d_hat: float = 0.0, d: float = 0.0) -> tuple[float, float, float]:
    estimate, context = Estimate(x, v, 1000.0, 1000.0, 0.0, 0.0, 0.0, 0.0, d), Context(Plant(), Limits(), 1e-3)
    return Nftsm().control(Z_a, d_hat, estimate, Setpoint(0.0, 0.0, 0.0), context)


@given(numbers, st.floats(0.1, 3))
def test_odd_power_is_odd_and_keeps_the_sign(z: float, exponent: float) -> None:
    value = odd_power(z, exponent, 1e-5)
    assert odd_power(-z, exponent, 1e-5) == -value
    assert value * z >= 0


@given(st.floats(0.01, 10), st.floats(0.1, 3))
def test_odd_power_is_the_power_far_from_zero(z: float, exponent: float) -> None:
    assert odd_power(z, exponent, 1e-5) == pytest.approx(z**exponent, rel=3e-6)


def test_smoothing_bounds_the_slope_at_zero() -> None:
    """A7: the cube root has no slope at zero; smoothed it has eps^(1/3 - 1)."""
    assert odd_power(1e-9, 1 / 3, 1e-5) / 1e-9 == pytest.approx(1e-5 ** (1 / 3 - 1), rel=1e-6)


@given(numbers, st.floats(-3, 3), st.floats(-1e5, 1e5), st.floats(-10, 10))
def test_saturated_force_is_within_the_limit(x: float, v: float, Z_a: float, d_hat: float) -> None:
    u, u_sat, _ = control(x, v, Z_a, d_hat)
    assert abs(u_sat) <= 5800
    assert u_sat == u or abs(u) > 5800


@given(st.floats(-1, 1), st.floats(-2, 2), st.floats(-0.2, 0.2))
def test_an_estimated_disturbance_is_taken_off_as_mass_times_its_acceleration(x: float, v: float, d_hat: float) -> None:
    assert control(x, v)[0] - control(x, v, d_hat=d_hat)[0] == pytest.approx(1e4 * d_hat, abs=1e-6)


@given(st.floats(-1, 1), st.floats(-2, 2), st.floats(-0.2, 0.2))
def test_a_disturbance_that_the_estimator_knows_counts_like_friction(x: float, v: float, d: float) -> None:
    assert control(x, v)[0] - control(x, v, d=d)[0] == pytest.approx(1e4 * d, abs=1e-6)


@given(st.floats(-0.4, 0.4), st.floats(-2, 2))
def test_behind_the_reference_it_pulls_harder(x: float, v: float) -> None:
    assert control(x - 0.1, v)[0] > control(x, v)[0]


def test_sliding_variable_by_hand() -> None:
    """At e1 = 0.2 m, e2 = 0.008 m/s: 0.2 + 0.008^(5/3)/0.05."""
    assert control(0.2, 0.008)[2] == pytest.approx(0.2 + 0.00032 / 0.05, rel=1e-5)


STIFF, LINEAR = NftsmGains(beta=0.3, phi=0.007), NftsmGains(beta=0.3, phi=0.007, linear_speed=0.01)


def accelerations(gains: NftsmGains, x: float, v: np.ndarray) -> np.ndarray:
    """Commanded accelerations of a vehicle without resistance, at speed errors in m/s."""
    free = Plant(vehicle=Vehicle(drag_coefficient=0.0, friction_coefficient=0.0))
    context, rest = Context(free, Limits(), 1e-3), Setpoint(0.0, 0.0, 0.0)
    states = (Estimate(x, float(speed), 1000.0, 1000.0, 0.0, 0.0, 0.0, 0.0) for speed in v)
    return np.array([Nftsm(gains).control(0.0, 0.0, state, rest, context)[0] for state in states]) / 1e4


@given(st.floats(0.02, 0.5))
def test_on_the_surface_a_linear_speed_bounds_the_slope_and_leaves_the_force(speed: float) -> None:
    """Where s = 0 the slope is k (p/q) v^(p/q − 1)/(beta phi), beside that of the terminal term."""
    x = -odd_power(speed, 5 / 3, 1e-5) / 0.3
    steps = speed + np.array([-1e-6, 0.0, 1e-6])
    stiff, linear = (accelerations(gains, x, steps) for gains in (STIFF, LINEAR))
    assert linear[1] == pytest.approx(stiff[1], rel=1e-6)
    slope_stiff, slope_linear = ((values[0] - values[2]) / 2e-6 for values in (stiff, linear))
    terminal = 0.3 * 0.6 / 3 * speed ** (-2 / 3)
    bound = 5 / 3 * (0.05 + 0.5 / 0.007) / 0.3 * 0.01 ** (2 / 3)
    assert slope_linear - terminal <= bound * 1.001
    assert slope_stiff - terminal == pytest.approx(bound * (speed / 0.01) ** (2 / 3), rel=1e-3)


@given(st.floats(-0.05, 0.05), st.floats(-0.5, 0.5))
def test_with_a_linear_speed_the_law_still_reduces_the_sliding_variable(x: float, v: float) -> None:
    """Lyapunov: s ds/dt <= 0, and the paper's law for small speed errors."""
    slope = 5 / 3 / 0.3 * (v * v + 1e-10) ** (1 / 3)
    s = x + odd_power(v, 5 / 3, 1e-5) / 0.3
    (acceleration,) = accelerations(LINEAR, x, np.array([v]))
    assert s * (v + slope * acceleration) <= 1e-12
    small = np.array([v / 1e4])  # the layer widens with the square of the speed error
    assert accelerations(LINEAR, x, small) == pytest.approx(accelerations(STIFF, x, small), rel=2e-3, abs=1e-6)
