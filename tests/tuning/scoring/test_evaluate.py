"""Evaluation: equal to runs of the tuned experiment, early for hopeless candidates, finite for diverged ones."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.ensembles.paired_run import paper_controller
from dualwinch.tuning.optimisers import linearise as lineariser
from dualwinch.tuning.prepared import STRESS, Prepared, prepare
from dualwinch.tuning.problem import MARGIN
from dualwinch.tuning.scoring import runs
from dualwinch.tuning.scoring.evaluate import FAILED, HOPELESS, LEADERS, MOST_TRIED, SURVEYED, Evaluator
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.hardness import FURTHER
from dualwinch.tuning.scoring.ranking import beats, best_first, pareto_front, promising_first
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


def test_better_than_the_start_is_what_breaks_no_more_and_has_a_smaller_objective() -> None:
    start = scored(1)
    assert beats(scored(0.5), start)
    assert not beats(scored(1), start)
    assert not beats(scored(2), start)
    assert not beats(scored(0.5, violation=0.1), start)
    assert not beats(scored(0.5, pruned=True), start)
    loud = scored(1, violation=0.5)
    assert beats(scored(2), loud)  # constraints come first
    assert beats(scored(0.5, violation=0.1), loud)
    assert not beats(scored(2, violation=0.1), loud)
    assert not beats(scored(0.5, violation=0.6), loud)
    assert beats(scored(2, 1), scored(1, 2))
    assert not beats(scored(2, 2), scored(1, 2))


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


def test_an_overwhelming_scenario_counts_in_no_statistic_and_may_exceed_bounds_by_a_little(
    make_problem: MakeProblem,
) -> None:
    prepared = prepare(make_problem(constraints=["worst.peak_tension<=5000"]))
    evaluator, start = Evaluator(prepared), Candidate(prepared.problem.start, "x")
    plain = prepared.scenarios[0]
    assert isinstance(plain, Scenario)
    scenarios = [plain, replace(plain, hard=True, overwhelming=True)]
    ran = evaluator.run([start], scenarios)

    def judged(peak: float) -> tuple[float, float]:
        result = replace(ran, metrics=ran.metrics | {"peak_tension": np.array([[3000.0, peak]])})
        found = evaluator.judged(start, result, scenarios)
        return found.statistics["worst.peak_tension"], found.violations["worst.peak_tension <= 5000 N"]

    assert judged(3000) == pytest.approx((3000, -0.4))
    assert judged(5200) == pytest.approx((3000, 0.04 - runs.LEEWAY))
    assert judged(5500) == pytest.approx((3000, 0.1 - runs.LEEWAY))


def test_the_start_is_evaluated_by_preparing(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    evaluator = Evaluator(prepared, prune=False)
    assert evaluator.start() == evaluator.evaluate([Candidate(prepared.problem.start, "start")])[0]


@pytest.mark.parametrize("kind", ["fando-nftsm", "adrc", "pid-cascade"])
def test_the_paper_is_its_own_controller_whatever_law_is_tuned(kind: str, make_problem: MakeProblem) -> None:
    settings = ["simulation.duration=0.1", f"controller.kind={kind}", "controller.nominal.mass=9e3"]
    prepared = prepare(make_problem(settings=settings, space=["controller.coordination.preload"]))
    problem = prepared.problem
    assert problem.experiment.controller.estimator.kind == "calibrating-kalman"
    theirs = problem.paper_experiment.controller
    assert replace(theirs, nominal=paper_controller().nominal) == paper_controller()
    assert theirs.nominal.mass == 9e3  # what is believed of the plant is no gain
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
    assert evaluator.rollouts == 2 * len(candidates) + 2 * sum(not trial.pruned for trial in found) + LEADERS * FURTHER
    assert len(leaders) == LEADERS
    assert not found[-1].pruned
    assert {trial.scenarios for trial in found if trial.pruned} == {2}
    few = Evaluator(prepared).evaluate(candidates[:3])
    assert sorted(trial.scenarios for trial in few) == [4, 4 + FURTHER, 4 + FURTHER]  # too few to be worth it
    whole = Evaluator(prepared, prune=False).evaluate(candidates)
    assert not any(trial.pruned for trial in whole)
    for early, late in zip(found, whole, strict=True):
        assert early.scenarios != 4 or early.statistics == late.statistics  # bit for bit: common scenarios


@pytest.mark.parametrize(("failing", "met"), [(0, LEADERS), (1, LEADERS), (LEADERS, 2 * LEADERS), (8, MOST_TRIED)])
def test_who_leads_has_met_the_further_scenarios(
    failing: int, met: int, make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared = prepare(make_problem())
    start = prepared.problem.start
    candidates = [Candidate(start | {BETA: share * float(start[BETA])}, "x") for share in np.linspace(0.5, 1.5, 8)]
    evaluator = Evaluator(prepared)
    common = evaluator.over(candidates, prepared.scenarios, tuning=True)
    worst, judged = [candidates[index] for index in promising_first(common)[:failing]], evaluator.judged

    def unless_tried(
        candidate: Candidate, result: BatchResult, scenarios: Sequence[Scenario], **words: Any
    ) -> Evaluation:
        found = judged(candidate, result, scenarios, **words)
        return replace(found, violations={"x": 1.0}) if candidate in worst and len(scenarios) > 4 else found

    monkeypatch.setattr(evaluator, "judged", unless_tried)
    found = evaluator.evaluate(candidates)
    assert sum(trial.scenarios == 4 + FURTHER for trial in found) == met
    leads = found[promising_first(found)[0]]
    assert leads.scenarios == (4 if failing == len(candidates) else 4 + FURTHER)
    assert leads.candidate == candidates[promising_first(common)[min(failing, MOST_TRIED) % len(candidates)]]


def test_candidates_that_exceed_a_bound_by_far_meet_no_further_scenarios(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(constraints=["worst.peak_tension<=1000"])))
    found = evaluator.evaluate([Candidate(evaluator.prepared.problem.start, "x")])
    assert found[0].violation > HOPELESS
    assert found[0].scenarios == 4


def test_every_so_often_the_one_that_leads_meets_all_hard_scenarios(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem()))
    start = evaluator.prepared.problem.start
    candidates = [Candidate(start | {BETA: share * float(start[BETA])}, "x") for share in (0.9, 1.0, 1.1)]
    for call in range(1, 2 * SURVEYED + 1):
        found = evaluator.evaluate(candidates)
        most = max(trial.scenarios for trial in found)
        assert most == 4 + (STRESS if call % SURVEYED == 0 else FURTHER)
        assert found[promising_first(found)[0]].scenarios == most


def test_candidates_with_slack_ropes_are_given_up_where_no_rope_may_be_slack(make_problem: MakeProblem) -> None:
    kp = "controller.winch_1.kp"
    tight, free = (
        Evaluator(
            prepare(
                make_problem(
                    settings=["simulation.duration=1"], space=[f"{kp}=1e-4:10:log"], scenarios=2, constraints=bounds
                )
            )
        )
        for bounds in (["worst.min_tension>=10"], ["mean.chatter<=100*paper"])
    )
    stiff, start = Candidate({kp: 0.5}, "method"), Candidate({kp: 0.5}, "start")
    (ours,) = tight.evaluate([stiff])
    assert ours.outcomes["went_slack"] > 0
    assert ours.statistics["worst.min_tension"] == 0
    assert ours.violations["worst.min_tension >= 10 N"] == pytest.approx(1 + MARGIN)
    assert ours.violations[FAILED] > 0
    (theirs,) = free.evaluate([stiff])
    assert set(theirs.outcomes) == {"completed"}, "where ropes may be slack nobody is given up for it"
    assert theirs.statistics["worst.min_tension"] == 0
    (first,) = tight.evaluate([start])
    assert set(first.outcomes) == {"completed"}, "what others are compared with runs to its end"
    assert set(tight.over([stiff], tight.prepared.scenarios)[0].outcomes) == {"completed"}


def test_diverged_candidates_are_infeasible_finite_and_survive_storage(make_problem: MakeProblem) -> None:
    problem = make_problem(
        settings=["simulation.duration=1"],
        space=["controller.winch.kd=0:100", "controller.winch.kp=1e-5:1e9"],
        scenarios=1,
    )
    prepared = prepare(problem)
    wild = Candidate({"controller.winch.kd": 90.0, "controller.winch.kp": 1e9}, "x")
    found = Evaluator(prepared).evaluate([wild])[0]
    numbers = [*found.objectives, *found.violations.values(), *found.statistics.values()]
    assert all(map(math.isfinite, numbers))
    assert finished_trial(found, problem.space).state.name == "COMPLETE"
    lost = Evaluator(prepared).judged(found.candidate, _all_diverged(prepared), prepared.scenarios)
    assert lost.violations[FAILED] == 1
    assert not lost.feasible
    assert lost.outcomes == {"diverged": 1}
    again = evaluation_of(finished_trial(lost, problem.space))
    assert (again.objectives, again.violations, again.statistics) == (lost.objectives, lost.violations, lost.statistics)


def _all_diverged(prepared: Prepared) -> BatchResult:
    result = prepared.paper
    broken = {name: np.full_like(values, np.nan) for name, values in result.metrics.items()}
    return replace(result, outcomes=np.full_like(result.outcomes, "diverged"), metrics=broken)


def test_an_interrupt_is_raised_even_where_every_rollout_is_finished(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch is so short that all of it is under way when Ctrl-C comes: it must not be lost."""
    prepared = prepare(make_problem())
    start = prepared.problem.start
    for module, name, call in (
        (runs, "rollout", lambda: Evaluator(prepared).evaluate([Candidate(start, "")])),
        (lineariser, "sensitivities", lambda: lineariser.linearise(prepared, prepared.scenarios, start)),
    ):
        whole = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, whole=whole, **b: replace(whole(*a, **b), interrupted=True))
        with pytest.raises(KeyboardInterrupt):
            call()
