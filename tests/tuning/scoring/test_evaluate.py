"""Evaluation: equal to runs of the tuned experiment, early for hopeless candidates, finite for diverged ones."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, penalised_first
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.selection_config import SelectionConfig
from tests.studies import MakeProblem
from tests.tiers import all_but

CONFIG = SelectionConfig()
MOST_TRIED, FURTHER, STRESS = CONFIG.most_leaders, CONFIG.pool_size, CONFIG.hard_training
BETA = "controller.nftsm.beta"


def test_an_evaluation_is_that_of_the_tuned_experiments(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    problem = prepared.problem
    point = problem.start | {BETA: 0.3}
    found = Evaluator(prepared, prune=False).evaluate([Candidate(point, "")])[0]
    scenarios = [scenario for scenario in prepared.scenarios if isinstance(scenario, Scenario)]
    settings = problem.space.settings(point)
    tuned = [scenario.having(settings) for scenario in scenarios]
    singles = rollout([], [[]], tuned).metrics
    typical = [not scenario.hard for scenario in scenarios]
    assert typical == [True, False, True, False]
    assert found.statistics["mean.mse"] == pytest.approx(singles["mse"][0, typical].mean(), rel=1e-12)
    assert found.statistics["worst.min_tension"] == pytest.approx(singles["min_tension"].min(), rel=1e-12)
    assert found.outcomes == {"completed": 4}


def test_the_start_is_evaluated_by_preparing(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    evaluator = Evaluator(prepared, prune=False)
    assert evaluator.start() == evaluator.evaluate([Candidate(prepared.problem.start, "start")])[0]


@pytest.mark.parametrize("kind", all_but(["fando-nftsm", "pid-cascade"], ["fando-nftsm", "adrc", "pid-cascade"]))
def test_the_paper_is_its_own_controller_whatever_law_is_tuned(kind: str, make_problem: MakeProblem) -> None:
    settings = ["simulation.duration=0.1", f"controller.kind={kind}", "controller.nominal.mass=9e3"]
    prepared = prepare(make_problem(settings=settings, space=["controller.coordination.preload"]))
    problem = prepared.problem
    assert problem.experiment.controller.estimator.kind == "calibrating-kalman"
    theirs = problem.paper_experiment.controller
    assert replace(theirs, nominal=paper_controller().nominal) == paper_controller()
    assert theirs.nominal.mass == 9e3  # nominal values of the plant are no gains
    chatter = prepared.paper.metrics["chatter"][0, [0, 2]].mean()  # the typical ones
    assert prepared.constraints[0].bound == pytest.approx(chatter)
    assert chatter != pytest.approx(prepared.start.metrics["chatter"][0, [0, 2]].mean(), rel=0.1)
    assert (problem.paper_point is not None) == (kind == "fando-nftsm")


def test_hopeless_candidates_stop_after_the_first_scenarios_and_the_paper_never(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    problem, evaluator = prepared.problem, Evaluator(prepared)
    points = [problem.start | {"controller.coordination.preload": load} for load in range(1000, 2001, 100)]
    candidates = [Candidate(point, "method") for point in points] + [Candidate(problem.start, "paper")]
    found = evaluator.evaluate(candidates)
    leaders = [trial for trial in found if trial.scenarios == 4 + FURTHER]
    kept = sum(not trial.pruned for trial in found)
    assert kept in (4, 5)  # one in three of twelve, and the paper's gains
    assert len(leaders) == round(kept / 3)  # one in three of those
    assert evaluator.rollouts == 2 * len(candidates) + 2 * kept + len(leaders) * FURTHER
    assert not found[-1].pruned
    assert {trial.scenarios for trial in found if trial.pruned} == {2}
    few = Evaluator(prepared).evaluate(candidates[:3])
    assert sorted(trial.scenarios for trial in few) == [4, 4, 4 + FURTHER]  # too few to be pruned
    whole = Evaluator(prepared, prune=False).evaluate(candidates)
    assert not any(trial.pruned for trial in whole)
    for early, late in zip(found, whole, strict=True):
        assert early.scenarios != 4 or early.statistics == late.statistics  # bit for bit: common scenarios


@pytest.mark.parametrize(("failing", "met"), [(0, 3), (1, 3), (3, 6), (8, MOST_TRIED)])
def test_who_leads_has_met_the_further_scenarios(
    failing: int, met: int, make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared = prepare(make_problem())
    start = prepared.problem.start
    candidates = [Candidate(start | {BETA: share * float(start[BETA])}, "x") for share in np.linspace(0.5, 1.5, 8)]
    evaluator = Evaluator(prepared)
    common = evaluator.over(candidates, prepared.scenarios, training=True)
    worst, judged = [candidates[index] for index in penalised_first(common)[:failing]], evaluator.evaluation

    def unless_tried(
        candidate: Candidate, result: BatchResult, scenarios: Sequence[Scenario], **words: Any
    ) -> Evaluation:
        found = judged(candidate, result, scenarios, **words)
        return replace(found, violations={"x": 1.0}) if candidate in worst and len(scenarios) > 4 else found

    monkeypatch.setattr(evaluator, "evaluation", unless_tried)
    found = evaluator.evaluate(candidates)
    assert sum(trial.scenarios == 4 + FURTHER for trial in found) == met
    leads = found[penalised_first(found)[0]]
    assert leads.scenarios == (4 if failing == len(candidates) else 4 + FURTHER)
    assert leads.candidate == candidates[penalised_first(common)[min(failing, MOST_TRIED) % len(candidates)]]


def test_candidates_that_exceed_a_bound_by_far_meet_no_further_scenarios(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(constraints=["worst.peak_tension<=1000"])))
    found = evaluator.evaluate([Candidate(evaluator.training.problem.start, "x")])
    assert found[0].violation > CONFIG.hopeless
    assert found[0].scenarios == 4


def test_every_so_often_the_one_that_leads_meets_all_hard_scenarios(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem()))
    start = evaluator.training.problem.start
    candidates = [Candidate(start | {BETA: share * float(start[BETA])}, "x") for share in (0.9, 1.0, 1.1)]
    for call in range(1, 2 * CONFIG.pool_review + 1):
        found = evaluator.evaluate(candidates)
        most = max(trial.scenarios for trial in found)
        assert most == 4 + (STRESS if call % CONFIG.pool_review == 0 else FURTHER)
        assert found[penalised_first(found)[0]].scenarios == most
