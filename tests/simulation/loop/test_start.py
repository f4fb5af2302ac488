"""The starting state as a function, against the one worked out for an experiment."""

from pathlib import Path

import numpy as np
import pytest

from dualwinch import override
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.blocks import block
from dualwinch.simulation.ensembles.ensemble import Drawn, Ensemble, Uniform
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import initial_state_of, start_slopes, starts
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.stepper.stepper import Stepper

EXPERIMENTS = [
    Experiment(),
    override(Experiment(), {"controller.coordination.preload": 3000.0, "plant.rope_1.modulus": 9e10}),
    override(Experiment(), {"sensors.encoder_counts": 4096, "plant.track.length": 40.0}),
]


def test_starts_are_those_of_the_experiments() -> None:
    vectors = np.array([list(parameters_of(experiment).values()) for experiment in EXPERIMENTS])
    found = starts(structure_of(EXPERIMENTS[0]), vectors, 0.0)
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
    lower, upper = starts(structure, vectors, 0.0)
    slopes = np.array(start_slopes(structure)(vector, 0.0))
    assert slopes[:, index] == pytest.approx((upper - lower) / (2 * step), rel=1e-6, abs=1e-15)
    assert np.abs(slopes[:, index]).max() > 0


def recorded(tmp_path: Path, **given: float | str) -> Experiment:
    """A motion from 5 m, under a filter that expects a position and a sensor that is 2 cm off."""
    file = tmp_path / "motion.csv"
    file.write_text("t,x\n" + "".join(f"{t},{5 + t**2 / 20}\n" for t in range(5)))
    motion = {"reference.kind": "file", "reference.file": str(file), "reference.unit": "m"}
    filtered = {"controller.estimator": "kalman", "sensors.position_bias": 0.02, "simulation.duration": 0.5}
    return override(Experiment(), motion | filtered | given)


def test_a_run_begins_where_its_reference_does(tmp_path: Path) -> None:
    experiment = recorded(tmp_path)
    result, begun = simulate(experiment), initial_state_of(experiment)
    assert result["x_ref"][0] == 5.0
    assert result["x"][0] == 4.98, "where the sensor reads 5 m"
    assert [result["F1"][0], result["F2"][0], result["v"][0]] == pytest.approx([1000, 1000, 0])
    assert begun["controller.estimator.x"] == 5.0
    exported = block("closed-loop", experiment)
    assert {state.name: state.start for state in exported.states}["motion.plant.x"] == 4.98
    assert {each.name: each.start for each in exported.inputs}["reference.x"] == 5.0
    plant, controller = block("plant", experiment), block("controller", experiment)
    assert {state.name: state.start for state in plant.states}["x"] == 5.0
    assert [each.start for each in controller.inputs if each.name in {"x", "x_ref"}] == [5.0, 5.0]


def test_so_do_batches_and_lanes(tmp_path: Path) -> None:
    experiment = recorded(tmp_path, **{"controller.estimator": "lowpass"})
    alone, usual = simulate(experiment), override(experiment, {"reference.kind": "profile"})
    both = rollout([], np.empty((1, 0)), [usual, experiment], stride=1)
    assert both.columns is not None
    assert both.columns["x"][0, :, 0] == pytest.approx([-0.02, 4.98])
    assert both.columns["x"][0, 1] == pytest.approx(alone["x"], abs=1e-9)
    drawn = Ensemble("masses", "", experiment, {"plant.vehicle.mass": Drawn(Uniform(9e3, 11e3))})
    for source in (experiment, drawn):
        assert Stepper(source, batch=2, command="force", signals=("x",)).reset()["x"] == pytest.approx(4.98)
