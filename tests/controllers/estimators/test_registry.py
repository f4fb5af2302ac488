"""What the position law sees."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.controllers.registry import ESTIMATORS
from dualwinch.model.plant import Plant, resting_state, tensions
from dualwinch.model.reference import Setpoint

MEASURED = Measurement(1.2, 0.7, 1500.0, 900.0, 0.9, -0.9, 1.5, -1.5)


def first_estimate(estimator: Estimator, measurement: Measurement) -> Estimate:
    context = Context(Plant(), Limits(), 1e-3)
    return estimator.step(estimator.initial_state(), measurement, Setpoint(0.0, 0.0, 0.0), context)[1]


@pytest.mark.parametrize("kind", ["none", "lowpass"])
def test_by_default_the_measurement_passes_as_it_is(kind: str) -> None:
    assert first_estimate(ESTIMATORS[kind](), MEASURED) == Estimate(**vars(MEASURED))


def test_a_filter_time_slows_the_speed_only() -> None:
    slowed = vars(first_estimate(LowPass(0.1), MEASURED))
    assert slowed.pop("v") == pytest.approx(0.7 / 101)
    assert slowed.items() <= vars(Estimate(**vars(MEASURED))).items()


@pytest.mark.parametrize("kind", ESTIMATORS)
@given(x=st.floats(-0.1, 0.1), v=st.floats(-1, 1), F1=st.floats(0, 6000), omega_1=st.floats(-5, 5))
def test_all_but_the_motion_passes_as_it_is(kind: str, x: float, v: float, F1: float, omega_1: float) -> None:
    measured = Measurement(x, v, F1, 900.0, omega_1, -0.9, 1.5, -1.5)
    given_on = vars(first_estimate(ESTIMATORS[kind](), measured))
    for name in ("F1", "F2", "omega_1", "omega_2", "theta_1", "theta_2"):
        assert given_on[name] == getattr(measured, name), name


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_a_plant_at_rest_is_seen_as_it_is(kind: str) -> None:
    rest = resting_state(2000.0, Plant())
    measured = Measurement(0.0, 0.0, *tensions(rest, Plant()), 0.0, 0.0, rest.theta_1, rest.theta_2)
    estimate = first_estimate(ESTIMATORS[kind](), measured)
    assert (estimate.x, estimate.v, estimate.d) == pytest.approx((0, 0, 0), abs=1e-9)


def test_a_kind_is_its_name_in_the_registry() -> None:
    assert {kind: estimator.kind for kind, estimator in ESTIMATORS.items()} == {kind: kind for kind in ESTIMATORS}
