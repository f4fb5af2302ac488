"""The Kalman bound of the tracking error."""

from dataclasses import replace

import pytest

import dualwinch
from benchmarks.least_error import least_error


def test_with_a_better_position_sensor_the_bound_is_smaller() -> None:
    ensemble = dualwinch.load_ensemble("site")
    usual, _ = least_error(ensemble, 250)
    quiet = {
        f"sensors.position_{name}": value for name, value in (("noise", 1e-5), ("resolution", 0.0), ("drift", 0.0))
    }
    stable = dualwinch.override(ensemble.experiment, quiet)
    found, _ = least_error(replace(ensemble, experiment=stable), 250)
    assert found < 0.1 * usual


def test_of_a_known_machine_without_encoders_it_is_the_average_of_its_noise() -> None:
    """One constant is unknown, which one sensor reads: its deviation falls as one over the root of the readings."""
    ensemble = dualwinch.load_ensemble("sea")
    quiet = {"disturbance.current_sigma": 0.0, "disturbance.normal_force_sigma": 0.0}
    known = replace(ensemble, experiment=dualwinch.override(ensemble.experiment, quiet), distributions={})
    assert least_error(known, 250) == pytest.approx((0.0, 0.0), abs=1e-12)
