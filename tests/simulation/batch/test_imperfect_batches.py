"""Imperfect machines in batches: lanes, threads, gradients and the linear loop know them."""

import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

NAMES, GAINS = ["controller.nftsm.beta", "controller.observer.l0"], [[2.0, 30.0], [3.0, 20.0]]


def rigs(count: int, duration: float = 6.0) -> list[Scenario]:
    rig = load_ensemble("rig", override(load_ensemble("sea").experiment, {"simulation.duration": duration}))
    return list(rig.scenarios(count, seed=3))


@pytest.mark.parametrize("threads", [1, 2])
def test_lanes_are_single_runs(threads: int) -> None:
    scenarios = rigs(5)
    batch = rollout(NAMES, GAINS, scenarios, stride=1, workers=threads)
    for i, j in ((0, 0), (1, 2), (1, 4)):
        changed = override(scenarios[j].experiment, dict(zip(NAMES, GAINS[i], strict=True)))
        alone = simulate(changed, nominal=scenarios[j].nominal)
        assert np.abs(batch.columns["e"][i, j] - alone["e"]).max() < 1e-12
        assert batch.metrics["mse"][i, j] == pytest.approx(alone.metrics["mse"], rel=1e-9)


@pytest.mark.slow
def test_errors_of_sensitivities_are_those_of_runs() -> None:
    scenarios = rigs(2)
    found, batch = sensitivities(NAMES, GAINS[:1], scenarios), rollout(NAMES, GAINS[:1], scenarios, stride=1)
    assert np.abs(found.errors - batch.columns["e"]).max() < 1e-12
    assert np.abs(found.metrics["mse"] / batch.metrics["mse"] - 1).max() < 1e-9


@pytest.mark.slow
def test_gradients_on_a_rig_are_those_of_central_differences() -> None:
    smooth, steps = {"sensors.position_resolution": 0.0, "sensors.encoder_counts": 0}, (1e-6, 1e-5)
    scenarios = [drawn.having(smooth) for drawn in rigs(1)]
    beta, l0 = GAINS[0]
    moved = [[beta * (1 + sign * step), l0] for step in steps for sign in (-1, 1)]
    lower, upper = rollout(NAMES, moved, scenarios).metrics["mae"].reshape(len(steps), 2).T
    gradient = sensitivities(NAMES, GAINS[:1], scenarios, stride=0).gradients["mae"][0, 0, 0]
    quotients = (upper - lower) / (2 * np.array(steps) * beta)  # where no kink lies in between
    assert np.abs(quotients / gradient - 1).min() < 1e-4


@pytest.mark.parametrize("v", [0.0, 1.8])
def test_the_linear_loop_knows_the_machine(v: float) -> None:
    """A torque that is 2 % too large is 2 % of loop gain; a drum that is larger pulls with a longer lever."""
    experiment = load_ensemble("rig").experiment
    plain = linear_open_loop(experiment, 25.0, v, "tau_1")
    strong = linear_open_loop(override(experiment, {"plant.winch_1.torque_error": 0.02}), 25.0, v, "tau_1")
    at = np.array([30.0])
    assert strong.response(at)[0, 0, 0] / plain.response(at)[0, 0, 0] == pytest.approx(1.02, rel=1e-6)
    larger = override(experiment, {"plant.winch_1.radius_error": 0.002, "plant.winch_1.eccentricity": 1e-4})
    loop, true = linear_closed_loop(larger, 25.0, v), linear_closed_loop(experiment, 25.0, v)
    ratio = loop.C[loop.outputs.index("F1"), loop.states.index("theta_1")]
    ratio /= true.C[true.outputs.index("F1"), true.states.index("theta_1")]
    assert ratio == pytest.approx(1.002, abs=3e-4)
