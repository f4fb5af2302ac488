"""Friction with memory, a sloping rail, load cells that lag and torques in steps, in the loops of all engines."""

from collections.abc import Mapping

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

EFFECTS = {
    "plant.vehicle.stiction": 0.5,
    "plant.vehicle.bristle_stiffness": 5e6,
    "plant.vehicle.bristle_damping": 1e5,
    "plant.track.tilt": 1e-3,
    "plant.track.waviness": 1e-3,
    "plant.rope_1.hysteresis": 14.0,
    "plant.rope_2.hysteresis": 7.0,
    "sensors.load_cell_time_constant": 3e-3,
    "sensors.drum_speed_resolution": 7e-4,
    "simulation.torque_step": 0.13,
}

DORMANT = {
    "plant.vehicle.stribeck_velocity": 0.05,
    "plant.vehicle.bristle_damping": 1e4,
    "plant.track.wavelength": 3.0,
    "plant.rope_1.hysteresis_strain": 1e-5,
}
"""How effects come and go, without their size."""


def machine(values: Mapping[str, object], duration: float) -> Experiment:
    return override(case(4), {**values, "simulation.duration": duration, "simulation.substeps": 20})


def test_readings_lag_and_torques_come_in_steps() -> None:
    """Motors give the nearest multiple of the step, and rows have what the controller asked for."""
    values = EFFECTS | {"simulation.readings": True, "actuator.kind": "motor", "actuator.motor.time_constant": 1e-9}
    result = simulate(machine(values, 0.1), engine="interpreter")
    assert np.ptp(result["F1"] - result["F1_read"]) > 1
    assert result["F1_read"][0] == result["F1"][0]
    for asked, given in ((result["tau_1"], result["torque_1"]), (result["tau_2"], result["torque_2"])):
        nearest = 0.13 * np.floor(asked / 0.13 + 0.5)
        assert given[1:] == pytest.approx(nearest[1:], abs=1e-4)
        assert np.abs(asked - nearest).max() > 0.05


def test_without_their_size_effects_are_not_there() -> None:
    plain, dormant = (simulate(machine(values, 0.1), engine="interpreter") for values in ({}, DORMANT))
    for name, column in plain.columns.items():
        assert np.array_equal(column, dormant[name]), name
    names = prepare(machine(DORMANT, 0.1)).loop.states
    assert names == prepare(machine({}, 0.1)).loop.states
    assert set(names) < set(prepare(machine(EFFECTS, 0.1)).loop.states)


def test_bristles_too_stiff_for_the_steps_are_refused() -> None:
    stiff = machine(EFFECTS | {"plant.vehicle.bristle_stiffness": 1e14, "simulation.integrator": "verlet"}, 0.1)
    with pytest.raises(
        ConfigurationError, match=r"substeps = 20: must be >= 59 for verlet .*vehicle on its bristles oscillates"
    ):
        prepare(stiff)
