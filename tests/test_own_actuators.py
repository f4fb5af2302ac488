"""Actuators, built in and of a user's own: between torque command and plant, in all that runs the closed loop."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.codegen.native import compile as compile_function
from dualwinch.model.actuators import Actuator, Demand, Ideal, Motor, NoState, is_ideal
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_pieces
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.oracle.sampled import Scenario, run
from tests.own_actuators import Drooping, TwoLags

SHORT = Simulation(duration=1.0)
ACTUATED = {
    "motor": Motor(time_constant=5e-3),
    "limited": Motor(time_constant=2e-3, rate_limit=200.0),
    "two-lags": TwoLags(),
    "drooping": Drooping(),
}


def experiment(actuator: Actuator, number: int = 4) -> Experiment:
    return replace(case(number, actuator=actuator), simulation=SHORT)


def filtered(command: np.ndarray, start: float, lag: float, sample_time: float = 1e-3) -> np.ndarray:
    """Mean torque of each sample behind a lag, from where a run begins."""
    torque, means = start, []
    for asked in command:
        following = asked + (torque - asked) * np.exp(-sample_time / lag)
        means.append(asked - lag * (following - torque) / sample_time)
        torque = following
    return np.array(means)


def test_the_torque_that_reaches_the_plant_is_the_lagged_command() -> None:
    result = simulate(experiment(Motor(time_constant=5e-3)))
    for number in (1, 2):
        expected = filtered(result[f"tau_{number}"], 0.8 / 36 * 1000, 5e-3)
        assert result[f"torque_{number}"] == pytest.approx(expected, abs=1e-9)
        assert np.abs(result[f"torque_{number}"] - result[f"tau_{number}"]).max() > 0.1
    assert result.units["torque_1"] == "N m"
    assert result.interpolation["torque_1"] == "held"


def test_a_run_equals_that_of_the_independent_implementation() -> None:
    late = override(experiment(Motor(time_constant=5e-3)), {"simulation.delay_samples": 2})
    ours = simulate(late)
    theirs = run(Scenario("fando-nftsm", 4, {"simulation.delay_samples": 2}, lag=5e-3), 1000)
    assert np.abs(ours["x"] - theirs["x"]).max() < 1e-7
    for name in ("F1", "F2"):
        assert np.abs(ours[name] - theirs[name]).max() < 1.0, name


def test_the_lag_comes_after_the_delay() -> None:
    late = override(experiment(Motor(time_constant=5e-3)), {"simulation.delay_samples": 3})
    result = simulate(late)
    held = 0.8 / 36 * 1000
    arriving = np.concatenate([[held] * 3, result["tau_1"][:-3]])
    assert result["torque_1"] == pytest.approx(filtered(arriving, held, 5e-3), abs=1e-9)


def test_drums_turn_as_the_torque_that_reaches_them_says() -> None:
    """Momentum of drum 1 over a sample: inertia times change of speed, by motor and rope."""
    result = simulate(experiment(Motor(time_constant=5e-3)))
    gained = 1.8 * np.diff(result["omega_1"])
    pulled = 0.8 * (result["F1"][1:] + result["F1"][:-1]) / 2 * 1e-3
    given = 36 * result["torque_1"][:-1] * 1e-3
    calm = slice(500, None)
    assert gained[calm] == pytest.approx((given - pulled)[calm], abs=2e-5)


def test_figures_of_merit_count_the_torque_that_reaches_the_plant() -> None:
    result = simulate(experiment(ACTUATED["limited"], 1))
    torques, speeds = (np.array([result[f"{name}_{n}"] for n in (1, 2)]) for name in ("torque", "omega"))
    assert result.metrics.continuous_load == pytest.approx(np.sqrt((torques**2).mean()))
    assert result.metrics.energy == pytest.approx(np.abs(36 * torques * speeds).sum() * 1e-3)
    assert result.metrics.torque_rate == pytest.approx(np.abs(np.diff(torques)).mean() / 1e-3)
    assert np.abs(np.diff(torques)).max() <= 200 * 1e-3 + 1e-9
    assert result["tau_1"][0] - 0.8 / 36 * 1000 > 100
    assert result["torque_1"][0] - 0.8 / 36 * 1000 < 0.2


@pytest.mark.parametrize("actuator", [*ACTUATED.values(), Ideal()], ids=[*ACTUATED, "ideal"])
def test_a_run_begins_in_equilibrium(actuator: Actuator) -> None:
    still = override(experiment(actuator), {"reference.kind": "way-points", "reference.points": (1e-9,)})
    result = simulate(still)
    assert result["F1"] == pytest.approx(1000, abs=1e-3)
    assert result["x"] == pytest.approx(0, abs=1e-6)


def test_the_ideal_actuator_is_not_there() -> None:
    plain = simulate(replace(case(4), simulation=SHORT))
    assert case(4, actuator=Ideal()) == case(4)
    assert not [name for name in plain.columns if name.startswith("torque_")]
    assert not [name for name in plain.final_state if name.startswith("actuator")]
    assert not [name for name in parameters_of(case(4)) if name.startswith("actuator")]


@dataclass(frozen=True)
class Halved(Ideal):
    """Made of the ideal one, and not ideal."""

    kind: ClassVar = "halved"

    def step(self, state: NoState, demand: Demand, sample_time: Scalar) -> tuple[NoState, Scalar]:  # noqa: ARG002
        return state, demand.torque / 2


def test_what_is_made_of_the_ideal_actuator_is_not_ideal() -> None:
    assert is_ideal(Ideal())
    assert not is_ideal(Halved())
    result = simulate(experiment(Halved()))
    assert result["torque_2"] == pytest.approx(result["tau_2"] / 2)


def test_a_motor_without_lag_is_the_ideal_one() -> None:
    quick, ideal = simulate(experiment(Motor(time_constant=1e-9))), simulate(experiment(Ideal()))
    assert np.abs(quick["x"] - ideal["x"]).max() < 1e-9


def test_a_lag_takes_phase_off_the_loop() -> None:
    ideal, lagging = (margins(linear_open_loop(experiment(one), 20.0, 0.5)) for one in (Ideal(), Motor(0.02)))
    assert lagging.phase < ideal.phase
    loop = linear_closed_loop(experiment(Motor(0.02)), 20.0, 0.5)
    assert {"actuator_1.torque", "actuator_2.torque"} <= set(loop.states)
    assert np.abs(np.linalg.eigvals(loop.A)).max() < 1


@pytest.mark.parametrize("actuator", [Motor(rate_limit=500.0), TwoLags()], ids=["motor", "own"])
def test_the_closed_loop_runs_as_a_block_too(actuator: Actuator) -> None:
    asked = experiment(actuator)
    whole, result = block("closed-loop", asked), simulate(asked)
    step, state = compile_function(whole.step), np.array([variable.start for variable in whole.states])
    parameters = np.array([variable.start for variable in whole.parameters])
    names, outputs = [variable.name for variable in whole.inputs], [variable.name for variable in whole.outputs]
    for index, signals in enumerate(next(iter(exogenous_pieces(asked, 200)))):
        every = dict(zip(closed_loop(structure_of(asked)).exogenous, signals.tolist(), strict=True))
        state, row = (np.array(value).ravel() for value in step(state, [every[name] for name in names], parameters))
        for name in ("x", "torque_1", "tau_2"):
            assert row[outputs.index(name)] == pytest.approx(result[name][index], rel=1e-9, abs=1e-12), name
        if index == 100:
            break
