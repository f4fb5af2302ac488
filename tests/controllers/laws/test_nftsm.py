import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.nftsm import Nftsm, odd_power
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint

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
