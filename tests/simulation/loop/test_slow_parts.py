"""A calibration that is updated every few samples: the code between updates is the same, only shorter."""

import casadi as ca
import numpy as np
import pytest

from dualwinch.analysis.operating_points import in_calm
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.model.quantities.quantity import Mark
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override

INTERVAL = "controller.drums.interval"


def calibrating(interval: int) -> Experiment:
    settings = {"controller.estimator": "self-calibrating-kalman", INTERVAL: interval, "simulation.duration": 0.1}
    settings |= {"sensors.position_noise": 6e-4, "sensors.speed_noise": 2e-3, "plant.winch_1.drum_radius": 0.801}
    return override(case(4), settings)


def test_between_updates_both_samples_are_the_same() -> None:
    experiment = calibrating(4)
    loop = closed_loop(structure_of(experiment))
    parameters = np.array(list(parameters_of(experiment).values()))
    state, updated = np.array(list(initial_state_of(experiment).values())), []
    fast = loop.fast_sample
    assert fast is not None
    for outside in exogenous_signals(experiment)[:12]:
        same = all(
            np.array_equal(np.array(ours), np.array(theirs))
            for ours, theirs in zip(
                fast(state, outside, parameters), loop.sample(state, outside, parameters), strict=True
            )
        )
        updated.append(not same)
        assert (state[loop.phase] == 0) == (not same)
        state = np.array(loop.step(state, outside, parameters)[0]).ravel()
    assert updated == [True, False, False, False] * 3
    assert loop.marked(Mark.PHASE).nonzero()[0].tolist() == [loop.phase]


def test_it_is_much_shorter() -> None:
    loop = closed_loop(structure_of(calibrating(8)))
    assert loop.fast_sample is not None
    fast, whole = (hoisted(function)[1].n_instructions() for function in (loop.fast_sample, loop.sample))
    assert fast < 0.6 * whole


@pytest.mark.parametrize("experiment", [calibrating(1), case(4)], ids=["every sample", "no calibration"])
def test_without_a_slow_part_there_is_one_kind_of_sample(experiment: Experiment) -> None:
    assert closed_loop(structure_of(experiment)).fast_sample is None


def test_analysis_updates_at_every_sample() -> None:
    loop = closed_loop(structure_of(in_calm(calibrating(8))))
    assert loop.fast_sample is None
    assert isinstance(loop.sample, ca.Function)
