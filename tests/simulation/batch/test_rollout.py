from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.codegen.drivers.batch import LANES
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

NAMES = ["controller.nftsm.beta", "controller.observer.l0"]
GAINS = np.column_stack([np.geomspace(0.02, 0.5, LANES + 3), np.linspace(1, 20, LANES + 3)])


def scenario(number: int, seed: int = 0, duration: float = 1.0) -> Experiment:
    """A case of the paper with a noisy speed sensor and a delay."""
    noisy = {"sensors.speed_noise": 1e-3, "simulation.seed": seed, "simulation.delay_samples": 1}
    return override(case(number), noisy | {"simulation.duration": duration})


def same(first: BatchResult, other: BatchResult, pick: Callable[[np.ndarray], np.ndarray]) -> bool:
    """Whether two results are the same to the last bit, after picking from the first."""
    tables = [(first.end_times, other.end_times)]
    tables += [(first.metrics[name], other.metrics[name]) for name in first.metrics]
    tables += [(first.columns[name], other.columns[name]) for name in first.columns]
    return all(np.array_equal(pick(ours), theirs, equal_nan=True) for ours, theirs in tables)


@pytest.mark.parametrize("number", [1, 4])
def test_a_batch_is_its_single_rollouts(number: int) -> None:
    """Case 1 goes through slack and saturation."""
    scenarios = [scenario(number, seed) for seed in (0, 1)]
    result = rollout(NAMES, GAINS[:3], scenarios, stride=10)
    for i, gains in enumerate(GAINS[:3]):
        for j, experiment in enumerate(scenarios):
            single = simulate(override(experiment, dict(zip(NAMES, gains.tolist(), strict=True))), stride=10)
            assert result.outcomes[i, j] == single.outcome
            assert np.abs(result.columns["x"][i, j] - single["x"]).max() < 1e-9
            assert result.metrics["mse"][i, j] == pytest.approx(single.metrics.mse, rel=1e-6)
            assert result.metrics["slack_share"][i, j] == single.metrics.slack_share
            assert result.metrics["saturated_share"][i, j] == single.metrics.saturated_share
            assert result.metrics["peak_tension"][i, j] == pytest.approx(single.metrics.peak_tension, rel=1e-9)


@pytest.mark.parametrize("engine", ["casadi", "interpreter"])
def test_a_batch_runs_in_the_engine_that_its_scenarios_ask_for(engine: str) -> None:
    """To the last bit as `simulate` there; in any order beside scenarios of other engines, and given up likewise."""
    asking = [override(scenario(4, seed, 0.3), {"simulation.engine": engine}) for seed in (0, 1)]
    mixed = [asking[0], scenario(4, 2, 0.3), asking[1]]
    result = rollout(NAMES, GAINS[:2], mixed, stride=7)
    assert same(result, rollout(NAMES, GAINS[:2], asking, stride=7), lambda table: table[:, [0, 2]])
    single = simulate(override(asking[1], dict(zip(NAMES, GAINS[1].tolist(), strict=True))), stride=7)
    assert np.array_equal(result.columns["x"][1, 2], single["x"])
    assert result.metrics["mse"][1, 2] == single.metrics.mse
    slack = override(scenario(1, 0, 0.3), {"simulation.engine": engine})
    ours, theirs = (rollout([], np.empty((1, 0)), [each], max_slack=0.0) for each in (slack, scenario(1, 0, 0.3)))
    assert ours.outcomes.tolist() == theirs.outcomes.tolist() == [["went_slack"]]
    assert ours.end_times == theirs.end_times


def test_lane_size_threads_and_neighbours_change_no_bit() -> None:
    scenarios = [scenario(4, seed, 0.3) for seed in range(3)]
    everything = rollout(NAMES, GAINS, scenarios, stride=7)
    assert same(everything, rollout(NAMES, GAINS, scenarios, stride=7, workers=1), lambda table: table)
    assert same(everything, rollout(NAMES, GAINS[5:6], scenarios[1:2], stride=7), lambda table: table[5:6, 1:2])
    assert same(everything, rollout(NAMES, GAINS[::-1], scenarios, stride=7), lambda table: table[::-1])


def test_a_lane_that_ends_early_leaves_the_others_alone() -> None:
    wild = GAINS.copy()
    wild[4] = 1e300, 1e308
    usual, result = rollout(NAMES, GAINS, [scenario(1)]), rollout(NAMES, wild, [scenario(1)])
    assert result.outcomes[4, 0] == "diverged"
    assert result.end_times[4, 0] < 1
    assert (np.delete(result.outcomes, 4) == "completed").all()
    for name, table in result.metrics.items():
        assert np.isnan(table[4, 0])
        assert np.array_equal(np.delete(table, 4), np.delete(usual.metrics[name], 4), equal_nan=True)


def test_runs_with_slack_ropes_are_given_up_where_that_is_asked_for() -> None:
    name, stiff = "controller.winch_1.kp", np.array([[0.001], [0.2], [0.01], [0.5]])  # the stiff ones go slack
    usual = rollout([name], stiff, [scenario(4)], stride=10)
    assert (usual.outcomes == "completed").all()
    assert usual.metrics["slack_share"][:, 0] == pytest.approx([0, 0.1, 0, 0.1], abs=0.03)
    result = rollout([name], stiff, [scenario(4)], stride=10, max_slack=0.02)
    assert result.outcomes[:, 0].tolist() == ["completed", "went_slack", "completed", "went_slack"]
    assert (result.end_times[[1, 3]] < 1).all()
    assert all(np.isnan(table[[1, 3]]).all() for table in result.metrics.values())
    for ours, theirs in ((result.metrics, usual.metrics), (result.columns, usual.columns)):
        assert all(np.array_equal(ours[key][::2], theirs[key][::2], equal_nan=True) for key in ours), (
            "the others, bit for bit"
        )
    assert same(usual, rollout([name], stiff, [scenario(4)], stride=10, max_slack=0.5), lambda table: table)


def test_a_draw_of_an_ensemble_keeps_the_plant_its_controller_assumes() -> None:
    sea = load_ensemble("sea")
    short = replace(sea, experiment=override(sea.experiment, {"simulation.duration": 2.0}))
    draws = list(short.scenarios(3, 7))
    result = rollout([], np.empty((1, 0)), draws)
    for j, draw in enumerate(draws):
        single = simulate(draw.experiment, nominal=draw.nominal)
        assert result.metrics["mse"][0, j] == pytest.approx(single.metrics.mse, rel=1e-6)
        assert result.metrics["mse"][0, j] != pytest.approx(simulate(draw.experiment).metrics.mse, rel=1e-3)


def test_preload_may_vary_from_pair_to_pair() -> None:
    name = "controller.coordination.preload"
    result = rollout([name], np.array([[1000.0], [3000.0]]), [scenario(2)], stride=1)
    assert result.columns["F1"][:, 0, 0] == pytest.approx([500, 1500])


def test_the_interpreter_of_an_integrator_without_a_shortcut_agrees_too() -> None:
    plain = override(scenario(4), {"simulation.integrator": "rk4", "simulation.substeps": 4})
    result = rollout([], np.empty((1, 0)), [plain], stride=1)
    assert np.abs(result.columns["x"][0, 0] - simulate(plain)["x"]).max() < 1e-9


def test_progress_grows_to_one() -> None:
    shares: list[float] = []
    rollout(NAMES, GAINS, [scenario(4, seed, 0.05) for seed in range(3)], progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_an_interrupt_keeps_what_is_finished() -> None:
    def interrupt(share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    scenarios = [scenario(4, seed, 0.05) for seed in range(60)]
    result = rollout(NAMES, GAINS, scenarios, workers=1, progress=interrupt)
    assert result.interrupted
    ran = result.outcomes != "not_run"
    assert 0.3 <= ran.mean() < 1
    assert np.isfinite(result.metrics["mse"][ran]).all()
    assert np.isnan(result.metrics["mse"][~ran]).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"names": ["controller.nftsm.bet", "controller.nftsm.k"]}, "did you mean 'controller.nftsm.beta'"),
        ({"names": ["beta", "controller.nftsm.k"]}, "did you mean 'controller.nftsm.beta'"),
        ({"names": [NAMES[0]] * 2}, "names: 'controller.nftsm.beta' is given 2 times"),
        ({"names": "plant.vehicle.mas"}, "did you mean 'plant.vehicle.mass'"),
        ({"parameters": np.ones((3, 1))}, r"shape \(3, 1\) must be \(n, 2\)"),
        ({"parameters": [["a", "b"]]}, "parameters: must be an array of numbers"),
        ({"scenarios": scenario(4)}, "scenarios: must be a list, not one Experiment"),
        ({"scenarios": [scenario(4), replace(scenario(4), controller=Controller(law=Nftsm()))]}, r"scenarios\[1\]"),
        ({"scenarios": []}, "at least one"),
        ({"stride": -3}, "stride = -3: must be a whole number >= 0"),
        ({"workers": 0}, "workers = 0: must be a whole number >= 1"),
        *(({"max_slack": share}, r"max_slack = .*: must be a share, 0 to 1") for share in (-0.1, 1.5, np.nan)),
    ],
)
def test_wrong_arguments_are_named(words: dict[str, Any], message: str) -> None:
    arguments = {"names": NAMES, "parameters": GAINS, "scenarios": [scenario(4)]} | words
    with pytest.raises(ConfigurationError, match=message):
        rollout(**arguments)


def test_zero_is_refused_where_it_would_need_other_code() -> None:
    key = "plant.winch_1.gear_stiffness"
    geared = override(case(4), {key: 1.4e6, "plant.winch_1.rotor_inertia": 0.02, "simulation.duration": 0.01})
    with pytest.raises(ConfigurationError, match=rf"parameters\[1\]: {key} = 0: must be > 0, as in the scenarios"):
        rollout([key], [[1e6], [0.0]], [geared])
