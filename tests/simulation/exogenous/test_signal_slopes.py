"""Slopes of signals from outside, against differences of the signals of changed experiments."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.signals import Signal
from dualwinch.simulation.exogenous.signals import check_shaped, exogenous_signals, shaped_by, signal_slope
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import exogenous_names
from dualwinch.simulation.settings import override

SEA = {
    "disturbance.current_sigma": 0.1,
    "disturbance.current_time": 0.5,
    "disturbance.current_limit": 0.12,
    "disturbance.normal_force_sigma": 0.2,
    "disturbance.normal_force_time": 2.0,
    "sensors.position_drift": 1e-3,
    "sensors.position_drift_time": 1.5,
    "plant.vehicle.normal_force": 4e3,
}
SHAPED = {
    "disturbance.current_sigma": ("current",),
    "disturbance.current_time": ("current",),
    "disturbance.current_limit": ("current",),
    "disturbance.normal_force_sigma": ("normal_force_variation",),
    "disturbance.normal_force_time": ("normal_force_variation",),
    "plant.vehicle.normal_force": ("normal_force_variation",),
    "sensors.position_drift_time": ("noise.drift",),
    "disturbance.force.scale": ("force",),
    "disturbance.current.scale": ("current",),
}


def sea() -> Experiment:
    experiment = override(Experiment(), SEA | {"simulation.duration": 3.0})
    force = Signal.from_arrays([0.0, 1.0, 5.0], [0.0, 2.0, -1.0], unit="kN", interpolation="previous")
    current = Signal.from_arrays([0.0, 5.0], [-0.1, 0.1], unit="m/s")
    return replace(experiment, disturbance=replace(experiment.disturbance, force=force, current=current))


def signal(experiment: Experiment, name: str) -> np.ndarray:
    return exogenous_signals(experiment)[:, exogenous_names(experiment.controller).index(name)]


@pytest.mark.parametrize("key", SHAPED)
def test_slopes_are_those_of_differences(key: str) -> None:
    value = SEA.get(key, 1.0)
    (name,) = SHAPED[key]
    upper, lower = (signal(override(sea(), {key: value * (1 + change)}), name) for change in (1e-6, -1e-6))
    quotient, slope = (upper - lower) / (2e-6 * value), signal_slope(sea(), name, key)
    turning = np.abs(np.abs(signal(override(sea(), {"disturbance.current.scale": 0.0}), "current")) - 0.12) < 1e-5
    apart = np.where((name == "current") & turning, 0.0, np.abs(quotient - slope))
    assert np.abs(slope).max() > 0
    assert apart.max() < 1e-5 * np.abs(slope).max()


@pytest.mark.parametrize(("key", "names"), SHAPED.items())
def test_what_a_number_shapes(key: str, names: tuple[str, ...]) -> None:
    assert shaped_by(key) == names


def test_what_shapes_nothing() -> None:
    for key in ("plant.vehicle.mass", "sensors.position_drift", "sensors.position_noise", "sensors.outage_length"):
        assert shaped_by(key) == ()


def test_scales_of_nothing_are_refused() -> None:
    calm = Experiment()
    with pytest.raises(ConfigurationError, match=r"disturbance\.force\.scale: must scale a signal that is given"):
        check_shaped(calm, "disturbance.force.scale")
    with pytest.raises(ConfigurationError, match=r"disturbance\.current_sigma = 0: must be > 0"):
        check_shaped(calm, "disturbance.current_sigma")
    check_shaped(calm, "plant.vehicle.normal_force")
    assert not signal_slope(calm, "normal_force_variation", "plant.vehicle.normal_force").any()
