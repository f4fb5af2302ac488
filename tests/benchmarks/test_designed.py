"""Machines that the benchmark of designed starts draws: in their ranges, consistent, and the same every time."""

import pytest

from benchmarks.designed import MACHINES, machine
from dualwinch.model.quantities.tree import leaves


@pytest.mark.parametrize("number", [0, MACHINES - 1])
def test_a_drawn_machine_is_within_its_ranges(number: int) -> None:
    ensemble = machine(number)
    assert leaves(ensemble.experiment) == leaves(machine(number).experiment)
    plant, limits = ensemble.experiment.plant, ensemble.experiment.controller.limits
    assert 1e3 <= plant.vehicle.mass <= 2e5
    assert 5 <= plant.track.length <= 300
    assert 3e-3 <= plant.rope_1.diameter <= 0.05
    assert 5e-4 <= ensemble.experiment.simulation.sample_time <= 1e-2
    assert plant.vehicle.mass * ensemble.experiment.reference.acceleration < limits.tension_max / 2
    assert limits.tension_max < 630e6 * plant.rope_1.diameter**2 / 5
