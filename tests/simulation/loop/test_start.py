"""The starting state as a function, against the one worked out for an experiment."""

import numpy as np
import pytest

from dualwinch import override
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import initial_state_of, start_slopes, starts
from dualwinch.simulation.loop.structure import parameters_of, structure_of

EXPERIMENTS = [
    Experiment(),
    override(Experiment(), {"controller.coordination.preload": 3000.0, "plant.rope_1.modulus": 9e10}),
    override(Experiment(), {"sensors.encoder_counts": 4096, "plant.track.length": 40.0}),
]


def test_starts_are_those_of_the_experiments() -> None:
    vectors = np.array([list(parameters_of(experiment).values()) for experiment in EXPERIMENTS])
    found = starts(structure_of(EXPERIMENTS[0]), vectors)
    expected = np.array([list(initial_state_of(experiment).values()) for experiment in EXPERIMENTS])
    assert found == pytest.approx(expected, rel=1e-14, abs=1e-300)
    assert np.ptp(found, axis=0).max() > 0


def test_slopes_are_differences_of_starts() -> None:
    experiment, key, step = Experiment(), "controller.coordination.preload", 1.0
    structure, names = structure_of(experiment), list(parameters_of(experiment))
    vector = np.array(list(parameters_of(experiment).values()))
    index = names.index(key)
    vectors = np.array([vector, vector])
    vectors[:, index] += (-step, step)
    lower, upper = starts(structure, vectors)
    slopes = np.array(start_slopes(structure)(vector))
    assert slopes[:, index] == pytest.approx((upper - lower) / (2 * step), rel=1e-6, abs=1e-15)
    assert np.abs(slopes[:, index]).max() > 0
