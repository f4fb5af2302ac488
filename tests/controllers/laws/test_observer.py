import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.controllers.laws.observer import ObserverGains, ObserverState, estimate_disturbance, remember

GAINS, SAMPLE_TIME = ObserverGains(), 1e-3


def observe(acceleration: float, samples: int, gains: ObserverGains = GAINS) -> list[float]:
    """Estimates while the speed error grows as a constant disturbance makes it."""
    state, estimates = ObserverState(), []
    for k in range(samples):
        e2 = acceleration * k * SAMPLE_TIME
        now = estimate_disturbance(state, e2, gains, SAMPLE_TIME)
        state = remember(now, e2, 0.0)
        estimates.append(now.d_hat)
    return estimates


def test_first_sample_says_nothing() -> None:
    assert observe(1.0, 1) == [0]


@settings(max_examples=15)
@given(st.floats(-2, 2))
def test_estimate_converges_to_a_constant_disturbance(d: float) -> None:
    assert observe(d, 3000)[-1] == pytest.approx(d, abs=1e-5)


def test_with_a_constant_gain_it_converges_exactly_exponentially() -> None:
    """The discretisation is exact for a held innovation: d (1 - exp(-l0 t)), whatever the sample time."""
    estimates = observe(0.3, 500, ObserverGains(kf=0.0))
    assert estimates[-1] == pytest.approx(0.3 * (1 - 2.718281828459045 ** (-5 * 0.499)), rel=1e-9)


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-10, 10))
def test_gain_stays_between_its_bounds(e2: float, before: float, d_hat: float) -> None:
    state = ObserverState(d_hat=d_hat, e2_previous=before, primed=1.0)
    assert 5 <= estimate_disturbance(state, e2, GAINS, SAMPLE_TIME).L1 <= 10 + 1e-12


def test_a_large_error_raises_the_gain() -> None:
    small, large = (
        estimate_disturbance(ObserverState(filtered=f, primed=1.0), f * SAMPLE_TIME, GAINS, SAMPLE_TIME).L1
        for f in (0.001, 0.2)
    )
    assert small < 5.2
    assert large == pytest.approx(10)
