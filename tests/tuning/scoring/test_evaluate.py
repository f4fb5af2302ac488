"""Evaluation: equal to runs of the tuned experiment, early for hopeless candidates, finite for diverged ones."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.tree import with_leaves
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.tuning.problem import STRESS, Problem
from dualwinch.tuning.scoring.evaluate import FAILED, LEADERS, Evaluator
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.ranking import best_first, pareto_front
from dualwinch.tuning.storage.record import evaluation_of, finished_trial
from tests.tuning.conftest import MakeProblem

BETA = "controller.nftsm.beta"


def scored(*objectives: float, violation: float = 0.0, pruned: bool = False) -> Evaluation:
    return Evaluation(Candidate({}, ""), objectives, {"c": violation}, {}, {}, 1, pruned)


def test_the_best_comes_first_constraints_before_objective() -> None:
    evaluations = [scored(1, violation=0.5), scored(3), scored(0.1, pruned=True), scored(2), scored(9, violation=0.1)]
    assert best_first(evaluations) == [3, 1, 4, 0, 2]


def test_the_front_is_what_no_other_feasible_one_beats() -> None:
    evaluations = [scored(1, 4), scored(2, 2), scored(3, 3), scored(4, 1), scored(0, 0, violation=1), scored(2, 2)]
    assert pareto_front(evaluations) == [0, 1, 5, 3]
    assert best_first(evaluations)[-2:] == [2, 4]


def test_an_evaluation_is_that_of_the_tuned_experiments(make_problem: MakeProblem) -> None:
    problem = make_problem()
    point = problem.start | {BETA: 0.3}
    found = Evaluator(problem, prune=False).evaluate([Candidate(point, "")])[0]
    scenarios = [one for one in problem.tuning_scenarios if isinstance(one, Scenario)]
    tuned = [replace(one, experiment=with_leaves(one.experiment, problem.space.settings(point))) for one in scenarios]
    singles = rollout([], [[]], tuned).metrics
    draws = [not one.extreme for one in scenarios]
    assert draws == [False, True, False, False]
    assert found.statistics["mean.mse"] == pytest.approx(singles["mse"][0, draws].mean(), rel=1e-12)
    assert found.statistics["worst.min_tension"] == pytest.approx(singles["min_tension"].min(), rel=1e-12)
    assert found.outcomes == {"completed": 4}


def test_the_paper_is_compared_without_estimator_and_constraints_hold_for_it(make_problem: MakeProblem) -> None:
    problem = make_problem()
    assert problem.experiment.controller.estimator.kind == "calibrating-kalman"
    assert problem.paper_experiment.controller.estimator.kind == "none"
    chatter = problem.paper_result.metrics["chatter"][0, 1]  # the only draw among corners
    assert problem.bounded[0].bound == pytest.approx(chatter)


def test_hopeless_candidates_stop_after_the_first_scenarios_and_the_paper_never(make_problem: MakeProblem) -> None:
    problem = make_problem()
    evaluator = Evaluator(problem)
    points = [problem.start | {"controller.coordination.preload": load} for load in (1200, 1400, 1600, 1800, 2000)]
    candidates = [Candidate(point, "method") for point in points] + [Candidate(problem.paper_point, "paper")]
    found = evaluator.evaluate(candidates)
    leaders = [one for one in found if one.scenarios == 4 + STRESS]
    assert evaluator.rollouts == 12 + 2 * sum(not one.pruned for one in found) + LEADERS * STRESS
    assert len(leaders) == LEADERS
    assert not found[-1].pruned
    assert {one.scenarios for one in found if one.pruned} == {2}
    few = Evaluator(problem).evaluate(candidates[:3])
    assert sorted(one.scenarios for one in few) == [4, 4 + STRESS, 4 + STRESS]  # too few to be worth it
    whole = Evaluator(problem, prune=False).evaluate(candidates)
    assert not any(one.pruned for one in whole)
    for early, late in zip(found, whole, strict=True):
        assert early.scenarios != 4 or early.statistics == late.statistics  # bit for bit: common scenarios


def test_diverged_candidates_are_infeasible_finite_and_survive_storage(make_problem: MakeProblem) -> None:
    problem = make_problem(
        assignments=["simulation.duration=1"],
        space=["controller.winch.kd=0:100", "controller.winch.kp=1e-5:1e9"],
        scenarios=1,
    )
    found = Evaluator(problem).evaluate([Candidate({"controller.winch.kd": 90.0, "controller.winch.kp": 1e9}, "x")])[0]
    numbers = [*found.objectives, *found.violations.values(), *found.statistics.values()]
    assert all(map(math.isfinite, numbers))
    assert finished_trial(found, problem.space).state.name == "COMPLETE"
    lost = Evaluator(problem).judged(found.candidate, _all_diverged(problem), problem.tuning_scenarios)
    assert lost.violations[FAILED] == 1
    assert not lost.feasible
    assert lost.outcomes == {"diverged": 1}
    again = evaluation_of(finished_trial(lost, problem.space))
    assert (again.objectives, again.violations, again.statistics) == (lost.objectives, lost.violations, lost.statistics)


def _all_diverged(problem: Problem) -> BatchResult:
    result = problem.paper_result
    broken = {name: np.full_like(values, np.nan) for name, values in result.metrics.items()}
    return replace(result, outcomes=np.full_like(result.outcomes, "diverged"), metrics=broken)
