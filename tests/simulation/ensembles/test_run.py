import os
import signal
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np
import pytest

from dualwinch.codegen.drivers.batch import LANES
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import BLOCKS, rollout
from dualwinch.simulation.ensembles import run as module
from dualwinch.simulation.ensembles.ensemble import Choice, Drawn, Ensemble, Uniform
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.metrics.metrics import BUILT_IN, metric_quantities
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots.traces import PIXEL_COLUMNS
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.lasting import lasting, peak_memory


def failing(ensemble: Ensemble) -> Ensemble:
    """An ensemble in which every other scenario or so diverges."""
    values = Drawn(Choice((0.2, 1e300)))
    return replace(ensemble, distributions={**ensemble.distributions, "disturbance.vortex_amplitude": values})


@pytest.fixture(scope="module")
def ten() -> EnsembleResult:
    return run_ensemble(lasting(1.0), 10, 7)


def same(first: EnsembleResult, other: EnsembleResult) -> bool:
    metrics = all(np.array_equal(first.metrics[name], other.metrics[name], equal_nan=True) for name in BUILT_IN)
    draws = all(np.array_equal(first.draws[key], other.draws[key]) for key in first.draws)
    return metrics and draws and first.outcomes.tolist() == other.outcomes.tolist()


def test_a_scenario_of_an_ensemble_is_that_scenario_alone(ten: EnsembleResult) -> None:
    ensemble = lasting(1.0)
    for index in (0, 9):
        scenario = ensemble.scenario(index, 7)
        alone = rollout([], np.empty((1, 0)), [scenario])
        whole = simulate(scenario.experiment, nominal=scenario.nominal)
        for name, value in asdict(whole.metrics).items():
            assert np.array_equal(ten.metrics[name][index], alone.metrics[name][0, 0], equal_nan=True)
            assert ten.metrics[name][index] == pytest.approx(value, rel=1e-6, nan_ok=True)
        assert ten.traces is not None
        stride = round((ten.traces.t[1] - ten.traces.t[0]) / 1e-3)
        for column, near in (("e", 1e-9), ("F1", 1e-3), ("F2", 1e-3)):
            np.testing.assert_allclose(ten.traces.sampled[column][index], whole[column][::stride], rtol=1e-6, atol=near)


@pytest.mark.parametrize("workers", [1, 3])
def test_results_do_not_depend_on_the_number_of_threads(workers: int, ten: EnsembleResult) -> None:
    assert same(run_ensemble(lasting(1.0), 10, 7, workers=workers), ten)


def test_a_scenario_that_diverges_leaves_its_neighbours_and_the_statistics_alone() -> None:
    ensemble = lasting(0.5)
    sound, mixed = run_ensemble(ensemble, 12, 7), run_ensemble(failing(ensemble), 12, 7)
    completed = mixed.completed
    assert set(mixed.outcome_counts) > {"completed"}
    assert sum(mixed.outcome_counts.values()) == 12
    for name in BUILT_IN:
        assert np.array_equal(mixed.metrics[name][completed], sound.metrics[name][completed], equal_nan=True)
        assert np.isnan(mixed.metrics[name][~completed]).all()
    assert mixed.statistic("worst.mse") == sound.metrics["mse"][completed].max()
    assert mixed.traces is not None
    assert len(mixed.traces.sampled["e"]) == completed.sum()


def test_a_value_that_is_sometimes_zero_leaves_a_scenario_as_it_is_alone() -> None:
    """The compiled code leaves out what is always zero; what a portion happens to hold must not decide that."""
    friction = Drawn(Choice((0.0, 0.1)))
    ensemble = replace(lasting(0.2), distributions={"plant.vehicle.friction_coefficient": friction})
    whole = run_ensemble(ensemble, 6, 3, traces=False)
    assert set(whole.draws["plant.vehicle.friction_coefficient"]) == {0.0, 0.1}
    for index in range(6):
        alone = rollout([], np.empty((1, 0)), [ensemble.scenario(index, 3)])
        assert alone.metrics["mse"][0, 0] == whole.metrics["mse"][index]


def test_an_ensemble_without_a_completed_scenario_is_a_result() -> None:
    values = {"disturbance.vortex_amplitude": Drawn(Choice((1e300,)))}
    result = run_ensemble(replace(lasting(0.5), distributions=values), 3, 0)
    assert "completed" not in result.outcome_counts
    assert np.isnan(result.statistic("worst.mse"))
    assert result.traces is None


def test_statistics_look_at_the_bad_end(ten: EnsembleResult) -> None:
    assert [name for name, metric in metric_quantities().items() if metric.small_is_bad] == ["min_tension"]
    for name in BUILT_IN:
        values, found = ten.metrics[name], ten.statistics[name]
        if name.startswith("steady"):
            assert np.isnan(found["mean"])  # it never came to that
            continue
        assert found["mean"] == pytest.approx(sum(values) / 10)
        assert found["median"] == pytest.approx(sum(sorted(values)[4:6]) / 2)
        assert found["worst"] == (min(values) if name == "min_tension" else max(values))
        assert ten.statistic(f"worst.{name}") == found["worst"]
        beyond = values < found["p95"] if name == "min_tension" else values > found["p95"]
        assert beyond.sum() <= 1


def test_an_interrupt_keeps_the_finished_scenarios() -> None:
    def interrupt(done: float) -> None:
        if done >= 4 / 1000:
            raise KeyboardInterrupt

    ensemble = lasting(0.5)
    result = run_ensemble(ensemble, 1000, 7, progress=interrupt)
    assert result.partial
    assert 4 <= len(result) < 1000
    whole = run_ensemble(ensemble, len(result), 7)
    assert same(result, whole)
    assert not whole.partial
    assert result.traces is not None
    assert whole.traces is not None
    np.testing.assert_equal(vars(result.traces), vars(whole.traces))


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_a_signal_in_the_middle_is_such_an_interrupt() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        result = run_ensemble(
            lasting(0.5),
            1000,
            7,
            progress=lambda done: os.kill(os.getpid(), signal.SIGINT) if done >= 4 / 1000 else None,
        )
    finally:
        signal.signal(signal.SIGINT, before)
    assert 4 <= len(result) < 1000
    assert result.partial


def test_an_interrupt_before_anything_is_finished_is_one() -> None:
    class Early(Ensemble):
        def chosen(self, *_: object, **__: object) -> list[Scenario]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_ensemble(Early(**vars(lasting(0.5))), 5, 7)


def test_scenarios_are_drawn_as_they_are_needed() -> None:
    drawn = set[int]()

    class Counted(Ensemble):
        def chosen(self, indices: Sequence[int], seed: int | Sequence[int], *, vertex: bool = False) -> list[Scenario]:
            drawn.update(indices)
            return super().chosen(indices, seed, vertex=vertex)

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    ensemble = Counted(**vars(lasting(0.1)))
    result = run_ensemble(ensemble, 1000, 0, workers=1, progress=interrupt)
    assert 0 < len(result) <= BLOCKS * LANES
    assert len(drawn) == BLOCKS * LANES


def test_memory_does_not_grow_beyond_the_metrics() -> None:
    run_ensemble(lasting(0.05), 4, 0, traces=False)  # imports and caches
    ensemble = lasting(0.05)
    few, many = (
        peak_memory(lambda count=count: run_ensemble(ensemble, count, 0, traces=False, workers=1))
        for count in (160, 960)
    )
    assert many - few < 800 * 2500


def test_traces_are_kept_of_so_many_scenarios_and_extremes_of_all(
    monkeypatch: pytest.MonkeyPatch, ten: EnsembleResult
) -> None:
    monkeypatch.setattr(module, "SAMPLED", 4)
    result = run_ensemble(lasting(1.0), 10, 7)
    assert result.traces is not None
    assert ten.traces is not None
    assert result.traces.sampled["F1"].shape == (4, len(ten.traces.t))
    assert len(ten.traces.t) <= PIXEL_COLUMNS
    assert np.array_equal(result.traces.highest["F1"], ten.traces.sampled["F1"].max(axis=0))
    assert np.array_equal(result.traces.lowest["e"], ten.traces.sampled["e"].min(axis=0))
    middle = ten.traces.quantiles("e", (0.5,))[0]
    assert np.allclose(middle, np.median(ten.traces.sampled["e"], axis=0))


EFFECTS = {
    "plant.winch_1.gear_loss": Uniform(0.1, 0.3),
    "plant.rope_1.mass_per_length": Uniform(2.0, 3.0),
    "plant.rope_1.hysteresis": Uniform(1.0, 14.0),
    "sensors.load_cell_time_constant": Uniform(1e-3, 3e-3),
}


@pytest.mark.parametrize("key", EFFECTS)
def test_an_effect_that_the_nominal_machine_lacks_is_in_the_runs_where_it_is_drawn(key: str) -> None:
    nominal = override(case(4), {"simulation.duration": 0.5})
    ensemble = Ensemble("x", "", nominal, {key: Drawn(EFFECTS[key])})
    found = run_ensemble(ensemble, 3, 0).metrics["max_abs_error"]
    for scenario, error in zip(ensemble.scenarios(3, 0), found, strict=True):
        assert error == pytest.approx(simulate(scenario.experiment, nominal=scenario.nominal).metrics.max_abs_error)
        assert error != pytest.approx(simulate(nominal).metrics.max_abs_error, rel=1e-3)


def test_scenarios_with_and_without_an_effect_are_not_run_as_alike() -> None:
    key = "plant.rope_1.mass_per_length"
    ensemble = Ensemble("x", "", override(case(4), {"simulation.duration": 0.1}), {key: Drawn(Choice((0.0, 2.36)))})
    with pytest.raises(ConfigurationError, match=f"zero or absent in one of them alone: .*{key}"):
        run_ensemble(ensemble, 8, 0)
    with pytest.raises(ConfigurationError, match=f"{key}: must be > 0, in"):
        tuning_problem(ensemble=ensemble)
