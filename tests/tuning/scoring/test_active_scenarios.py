"""Active scenarios: those that the best violate come first, the typical ones stay, old violations fade."""

from collections.abc import Sequence

import pytest

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.training_set import ActiveScenarios, TrainingSet, prepare
from dualwinch.tuning.selection_config import SelectionConfig
from tests.studies import MakeProblem
from tests.tuning.scoring.test_runs import peaks

FURTHER, STRESS = SelectionConfig.pool_size, SelectionConfig.hard_training
BOUND, CALM, HIGH = 5000.0, 3000.0, 6000.0
PEAK = f"worst.peak_tension<={BOUND:g}"


@pytest.fixture
def prepared(make_problem: MakeProblem) -> TrainingSet:
    return prepare(make_problem(constraints=[PEAK]))


def test_it_begins_with_the_scenarios_as_they_were_prepared(prepared: TrainingSet) -> None:
    pool = ActiveScenarios(prepared)
    assert pool.common == prepared.scenarios
    assert (*pool.active, *pool.inactive) == prepared.hard
    assert (len(pool.active), len(pool.inactive)) == (FURTHER, STRESS - FURTHER)
    pool.learn([])
    assert pool.common == prepared.scenarios


def test_a_scenario_that_the_best_fail_in_becomes_the_first_hard_one_of_all_candidates(prepared: TrainingSet) -> None:
    pool, failing = ActiveScenarios(prepared), prepared.hard[5]
    every = [*pool.common, *pool.active]
    pool.learn([peaks([HIGH if scenario is failing else CALM for scenario in every])])
    typical, hard = prepared.scenarios[::2], prepared.scenarios[1::2]
    assert pool.common == (typical[0], failing, typical[1], hard[0])
    assert pool.active[0] is hard[1]
    assert len(pool.active) == FURTHER
    assert set(map(id, [*pool.common, *pool.active])) == set(map(id, every))


def test_a_review_finds_scenarios_that_have_become_harder(prepared: TrainingSet) -> None:
    pool = ActiveScenarios(prepared)
    failing = pool.inactive[20]
    every = [*pool.common, *pool.active, *pool.inactive]
    pool.learn([peaks([HIGH if scenario is failing else CALM for scenario in every])])
    assert pool.common[1] is failing
    assert len(set(map(id, every))) == len(every) == len(prepared.scenarios) + STRESS
    assert set(map(id, every)) == set(map(id, [*pool.common, *pool.active, *pool.inactive]))


def test_failures_are_read_in_the_order_of_the_scenarios_and_fade(prepared: TrainingSet) -> None:
    pool, first, then = ActiveScenarios(prepared), prepared.hard[5], prepared.hard[9]

    def fail(failing: Experiment | Scenario) -> None:
        every = [*pool.common, *pool.active]
        pool.learn([peaks([HIGH if scenario is failing else CALM for scenario in every])])

    fail(first)
    fail(first)
    assert pool.common[1] is first
    for _ in range(4):
        fail(then)
    assert (pool.common[1], pool.common[3]) == (then, first)


def test_the_best_of_a_call_count_by_their_mean(prepared: TrainingSet) -> None:
    pool, count = ActiveScenarios(prepared), len(prepared.scenarios) + FURTHER
    both, once = [CALM] * count, [CALM] * count
    both[10] = once[10] = 1.02 * BOUND
    once[12] = 1.03 * BOUND
    every = [*pool.common, *pool.active]
    pool.learn([peaks(both), peaks(once)])
    assert pool.common[1] is every[10]
    assert pool.common[3] is every[12]


def test_candidates_are_run_where_the_best_before_them_failed(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    seed = 10  # of draws among which the further ones are harder
    start = prepare(make_problem(seed=seed)).problem.start
    candidates = [Candidate(start | {"controller.observer.l0": float(gain)}, "x") for gain in range(5, 15)]
    free = Evaluator(prepare(make_problem(seed=seed)))
    common, further = (
        free.run(candidates, chosen).metrics["peak_tension"].max(axis=0)
        for chosen in (free.training.scenarios, free.training.hard[:FURTHER])
    )
    assert further.max() > 1.03 * common.max(), "else there is nothing to learn"
    bounds = [f"worst.peak_tension<={0.99 * further.max()}"]
    evaluator = Evaluator(prepare(make_problem(seed=seed, constraints=bounds)))
    hardest = evaluator.training.hard[int(further.argmax())]
    met, run = list[Sequence[Experiment | Scenario]](), evaluator.run

    def noted(
        candidates: Sequence[Candidate] | None, scenarios: Sequence[Experiment | Scenario], *, to_the_end: bool = True
    ) -> BatchResult:
        met.append(scenarios)
        return run(candidates, scenarios, to_the_end=to_the_end)

    monkeypatch.setattr(evaluator, "run", noted)
    evaluator.evaluate(candidates)
    assert hardest not in met[0]
    met.clear()
    evaluator.evaluate(candidates)
    assert hardest in met[0]
