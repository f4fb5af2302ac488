"""Figures of merit against a plain recomputation from the columns."""

from dataclasses import fields, replace

import numpy as np
import pytest

from dualwinch.model.ropes import kelvin_voigt
from dualwinch.simulation.experiment import Simulation
from dualwinch.simulation.metrics.metrics import Metrics
from dualwinch.simulation.paper import CONTROLLERS, case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate
from tests.conftest import PaperRun


def recomputed(result: Result) -> dict[str, float]:
    """The metrics of a run without delay, from its columns alone."""
    t, e = result["t"], np.abs(result["e"])
    first, last = (18.0, 29.0) if result.experiment.reference.kind == "profile" else (20.0, 25.0)
    steady = e[(t > first - 5e-4) & (t < last + 5e-4)]
    tensions = np.array([result["F1"], result["F2"]])
    torques = np.array([result["tau_1"], result["tau_2"]])
    drums = np.array([result["omega_1"], result["omega_2"]])
    at_limit = (torques <= 0.8 / 36 * 200) | (torques >= 0.8 / 36 * 6000)
    return {
        "mae": e.mean(),
        "max_abs_error": e.max(),
        "mse": (e**2).mean(),
        "steady_mae": steady.mean(),
        "steady_max_abs_error": steady.max(),
        "steady_mse": (steady**2).mean(),
        "saturated_share": np.mean(result["u"] != result["u_sat"]),
        "torque_saturated_share": at_limit.any(axis=0).mean(),
        "slack_share": (tensions == 0).any(axis=0).mean(),
        "peak_tension": tensions.max(),
        "min_tension": tensions.min(),
        "chatter": np.abs(np.diff(tensions)).mean(),
        "energy": 1e-3 * np.abs(36 * torques * drums).sum(),
        "torque_rate": np.abs(np.diff(torques)).mean() / 1e-3,
        "continuous_load": np.sqrt((torques**2).mean()),
    }


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("number", [1, 4])
def test_metrics_equal_their_recomputation(number: int, kind: str, paper_run: PaperRun) -> None:
    result = paper_run(number, kind)
    # A tension is E A by a strain, a difference of two numbers near one. Compilers may fuse and round it differently
    # where it is recorded and where its changes are summed, each time by this much.
    rope = kelvin_voigt(result.experiment.plant.rope_1)
    round_off = {"chatter": rope.modulus * rope.area * np.finfo(float).eps}
    for name, value in recomputed(result).items():
        assert getattr(result.metrics, name) == pytest.approx(value, rel=1e-9, abs=round_off.get(name, 0.0)), name


def test_every_metric_is_recomputed(paper_run: PaperRun) -> None:
    assert set(recomputed(paper_run(4, "nftsm"))) == {field.name for field in fields(Metrics)}


def test_a_run_that_ends_before_the_steady_state_has_none() -> None:
    metrics = simulate(replace(case(4), simulation=Simulation(duration=5.0))).metrics
    assert np.isnan(metrics.steady_mae)
    assert np.isnan(metrics.steady_max_abs_error)
    assert np.isnan(metrics.steady_mse)
    assert metrics.mae > 0


def test_a_single_sample_has_no_chatter() -> None:
    metrics = simulate(replace(case(1), simulation=Simulation(duration=1e-3))).metrics
    assert np.isnan(metrics.chatter)
    assert metrics.peak_tension == pytest.approx(1000)


def test_delayed_torques_do_the_work() -> None:
    """The energy counts the torque at the motor, not the one commanded in the sample."""
    result = simulate(replace(case(1), simulation=Simulation(duration=0.5, delay_samples=2)))
    torques = np.array([result["tau_1"], result["tau_2"]])
    at_motor = np.hstack([np.full((2, 2), 0.8 / 36 * 1000), torques[:, :-2]])
    drums = np.array([result["omega_1"], result["omega_2"]])
    assert result.metrics.energy == pytest.approx(1e-3 * np.abs(36 * at_motor * drums).sum(), rel=1e-9)
