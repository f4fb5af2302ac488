from dataclasses import replace

import numpy as np
import pytest

from dualwinch.codegen.drivers.batch import LANES
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.kalman import Kalman
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.batch.rollout import BLOCKS
from dualwinch.simulation.ensembles import run
from dualwinch.simulation.ensembles.comparison import COMPARED, compare, paired_ratio
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.settings import override
from tests.lasting import lasting


@pytest.fixture(scope="module")
def sea() -> Ensemble:
    return lasting(0.3)


def stronger() -> Controller:
    return replace(paper_controller(), estimator=Kalman(), limits=Limits(preload=3e3))


def test_each_controller_meets_the_ensemble_as_if_alone(sea: Ensemble) -> None:
    result = compare({"paper": paper_controller(), "other": stronger()}, sea, 5, 3)
    for name, contender in result.contenders.items():
        alone = run_ensemble(
            replace(sea, experiment=replace(sea.experiment, controller=contender.controller)), 5, 3, traces=False
        )
        for metric, values in contender.metrics.items():
            np.testing.assert_allclose(values, alone.metrics[metric], rtol=1e-6, err_msg=f"{name} {metric}")
        summary = contender.summary()
        assert summary["mean_mse"] == pytest.approx(alone.statistic("mean.mse"), rel=1e-6)
        assert summary["min_tension"] == pytest.approx(alone.metrics["min_tension"].min(), rel=1e-6)
        assert summary["slack_scenarios"] == (alone.metrics["slack_share"] > 0).sum()
        assert summary["outcomes"] == {"completed": 5}


def test_portions_and_threads_change_no_bit(sea: Ensemble) -> None:
    """40 scenarios on one thread are two portions, on two threads one."""
    contenders = {"paper": paper_controller()}
    results = [compare(contenders, sea, 40, 1, workers=threads).contenders["paper"] for threads in (1, 2)]
    for metric, values in results[0].metrics.items():
        np.testing.assert_array_equal(values, results[1].metrics[metric])


def test_a_controller_over_itself_is_one(sea: Ensemble) -> None:
    result = compare({"a": paper_controller(), "b": paper_controller()}, sea, 4, 0)
    for pair in result.paired("b").values():
        assert (pair.ratio_of_means.low, pair.ratio_of_means.estimate, pair.ratio_of_means.high) == (1, 1, 1)
        assert (pair.pairs, pair.better) == (4, 0)


def test_pairs_without_a_completed_run_are_left_out(sea: Ensemble) -> None:
    result = compare({"a": paper_controller(), "b": stronger()}, sea, 4, 0)
    b = result.contenders["b"]
    outcomes = b.outcomes.copy()
    outcomes[1] = "diverged"
    values = b.metrics["mse"].copy()
    values[1] = np.inf
    broken = replace(b, outcomes=outcomes, metrics=b.metrics | {"mse": values})
    result = replace(result, contenders=result.contenders | {"b": broken})
    pair = result.paired("b")["mse"]
    kept = [0, 2, 3]
    assert pair.pairs == 3
    expected = b.metrics["mse"][kept].mean() / result.contenders["a"].metrics["mse"][kept].mean()
    assert pair.ratio_of_means.estimate == pytest.approx(expected)
    assert broken.summary()["outcomes"] == {"completed": 3, "diverged": 1}
    nothing = replace(b, outcomes=np.full(4, "diverged"))
    result = replace(result, contenders={"a": nothing})
    assert set(result.paired("a")) == set(COMPARED)
    assert np.isnan(nothing.summary()["mean_mse"])  # pyright: ignore[reportArgumentType, reportCallIssue]


def test_intervals_cover_the_true_ratio_as_often_as_they_say() -> None:
    """Log-normal pairs that share most of their spread; the means' true ratio is 0.8."""
    generator = np.random.default_rng(5)
    covered, studies = 0, 60
    for study in range(studies):
        shared = generator.lognormal(0, 0.7, 80)
        values = 0.8 * shared * generator.lognormal(-0.005, 0.1, 80)
        interval = paired_ratio(values, shared, study).ratio_of_means
        covered += interval.low <= 0.8 <= interval.high
        assert interval.high - interval.low < 0.15  # unpaired it would be about 0.4
    assert covered / studies >= 0.85


def test_the_seed_determines_the_intervals() -> None:
    values, references = np.random.default_rng(0).lognormal(size=(2, 30))
    assert paired_ratio(values, references, 4) == paired_ratio(values, references, 4)
    assert paired_ratio(values, references, 4) != paired_ratio(values, references, 5)


def test_an_interrupt_keeps_what_all_have_finished(sea: Ensemble, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, whole = [], run.rollout

    def interrupted(*words, **options):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return whole(*words, **options)

    monkeypatch.setattr(run, "rollout", interrupted)
    result = compare({"a": paper_controller(), "b": stronger()}, sea, 40, 0, workers=1)
    assert result.partial
    assert {len(contender.outcomes) for contender in result.contenders.values()} == {BLOCKS * LANES}
    assert result.paired("b")["mse"].pairs == BLOCKS * LANES


def test_foresight_could_reach_less_error_where_motors_lack_force_and_only_there() -> None:
    sea, weak = load_ensemble("sea"), replace(paper_controller(), limits=Limits(tension_max=4600.0))
    experiment = replace(override(sea.experiment, {"simulation.duration": 20.0}), controller=weak)
    result = compare({"weak": weak}, replace(sea, experiment=experiment), 4, 1)
    least = result.least_errors
    lacking = least.without_foresight > 0
    assert lacking.any()
    assert np.all(least.with_foresight[lacking] < least.without_foresight[lacking])
    assert np.all(least.with_foresight[lacking] > 0)
    assert np.all(least.with_foresight[~lacking] == 0)
    assert np.all(result.contenders["weak"].metrics["mse"] > least.without_foresight)
