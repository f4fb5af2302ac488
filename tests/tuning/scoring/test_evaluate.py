"""Evaluation: equal to runs of the tuned experiment; cuts and back-off from checks of the leader."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.cutting_set import CUTS_AT_ONCE
from dualwinch.tuning.scoring.evaluation import Evaluator, point_key
from dualwinch.tuning.scoring.fresh_means import FreshMeans
from dualwinch.tuning.scoring.ranking import Candidate, penalised_first
from dualwinch.tuning.scoring.training_set import prepare
from tests.studies import FEW, MakeProblem
from tests.tiers import all_but

BETA, PRELOAD = "controller.nftsm.beta", "controller.coordination.preload"


def loads(evaluator: Evaluator, values: Sequence[float]) -> list[Candidate]:
    """Candidates with these preloads."""
    return [Candidate(evaluator.problem.start | {PRELOAD: value}, "method") for value in values]


def test_an_evaluation_is_that_of_the_tuned_experiments(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    problem = prepared.problem
    point = problem.start | {BETA: 0.3}
    found = Evaluator(prepared).evaluate([Candidate(point, "")])[0]
    scenarios = [scenario for scenario in (*prepared.scenarios, *prepared.hard) if isinstance(scenario, Scenario)]
    tuned = [scenario.having(problem.space.settings(point)) for scenario in scenarios]
    singles = rollout([], [[]], tuned).metrics
    counted = [not scenario.hard for scenario in scenarios]
    assert counted == [True] * 4 + [False] * 2
    assert found.statistics["mean.mse"] == pytest.approx(singles["mse"][0, counted].mean(), rel=1e-12)
    assert found.statistics["worst.min_tension"] == pytest.approx(singles["min_tension"].min(), rel=1e-12)
    assert found.outcomes == {"completed": 6}


def test_the_start_is_evaluated_by_preparing(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem()))
    assert evaluator.start() == evaluator.evaluate([Candidate(evaluator.problem.start, "start")])[0]


@pytest.mark.parametrize("kind", all_but(["fando-nftsm", "pid-cascade"], ["fando-nftsm", "adrc", "pid-cascade"]))
def test_the_paper_is_its_own_controller_whatever_law_is_tuned(kind: str, make_problem: MakeProblem) -> None:
    settings = ["simulation.duration=0.1", f"controller.kind={kind}", "controller.nominal.mass=9e3"]
    prepared = prepare(make_problem(settings=settings, space=[PRELOAD]))
    problem = prepared.problem
    assert problem.experiment.controller.estimator.kind == "calibrating-kalman"
    theirs = problem.paper_experiment.controller
    assert replace(theirs, nominal=paper_controller().nominal) == paper_controller()
    assert theirs.nominal.mass == 9e3  # nominal values of the plant are no gains
    chatter = prepared.paper.metrics["chatter"][0].mean()
    assert prepared.constraints[0].bound == pytest.approx(chatter)
    assert chatter != pytest.approx(prepared.start.metrics["chatter"][0, :4].mean(), rel=0.1)
    assert (problem.paper_point is not None) == (kind == "fando-nftsm")


def test_a_batch_is_halved_while_its_scenarios_double_and_the_papers_gains_are_run_in_all(
    make_problem: MakeProblem,
) -> None:
    evaluator = Evaluator(prepare(make_problem(options=replace(FEW, check_share=0.0))))
    candidates = [*loads(evaluator, np.linspace(1000, 2400, 15).tolist()), Candidate(evaluator.problem.start, "paper")]
    found = evaluator.evaluate(candidates)
    assert not found[-1].pruned
    assert not found[penalised_first(found)[0]].pruned
    counts = Counter(trial.scenarios for trial in found)
    assert counts[6] in (2, 3)  # the paper's gains may be among the last
    assert counts[3] in (1, 2)
    assert counts[1] == 16 - counts[6] - counts[3]
    assert evaluator.rollouts == sum(number * count for number, count in counts.items())


@pytest.mark.parametrize("back_off", [False, True])
def test_draws_in_which_the_leader_violates_a_bound_become_cuts(back_off: bool, make_problem: MakeProblem) -> None:
    free = Evaluator(prepare(make_problem()))
    (leader,) = loads(free, [1500])
    draws = free.fresh("checks", 0, 100)
    peaks = free.run([leader], draws.scenarios).metrics["peak_tension"][0]
    trained = free.evaluate([leader])[0].statistics["worst.peak_tension"]
    bound = (trained + peaks.max()) / 2
    assert trained < bound < peaks.max(), "worse in fresh draws than in training"
    evaluator = Evaluator(prepare(make_problem(constraints=[f"worst.peak_tension<={bound}"])))
    (trial,) = evaluator.evaluate([leader])
    assert trial.feasible
    entry = evaluator.archive[point_key(leader)]
    before = dict(evaluator.cutting.cuts)
    runs = evaluator.run([leader], draws.scenarios)
    evaluator.learn(entry, draws, runs, FreshMeans(evaluator, 0.05), back_off=back_off)
    added = [cut for number, cut in evaluator.cutting.cuts.items() if number not in before]
    worst = np.argsort(-peaks)[: min(CUTS_AT_ONCE, int((peaks > bound).sum()))]
    assert {cut.index for cut in added} == {draws.scenarios[index].index for index in worst}
    assert all(cut.hard for cut in added)
    assert entry.evaluation.statistics["worst.peak_tension"] == pytest.approx(peaks.max())
    (constraint,) = evaluator.training.constraints
    learnt = {constraint.label: pytest.approx((peaks.max() - trained) / bound)} if back_off else {}
    assert evaluator.cutting.back_off == learnt, "slack in training and excess"
    calmer, louder = evaluator.evaluate(loads(evaluator, [800, 2400]))
    assert calmer.scenarios == 6 + len(added)
    assert calmer.statistics["worst.peak_tension"] < louder.statistics["worst.peak_tension"]


def test_a_violated_mean_raises_its_back_off_to_the_slack_in_training_and_the_excess(make_problem: MakeProblem) -> None:
    cutting = Evaluator(prepare(make_problem())).cutting
    cutting.learn_back_off({"mean": 0.01}, {"mean": -0.17})
    assert cutting.back_off == {"mean": pytest.approx(0.18)}
    cutting.learn_back_off({"mean": -0.01}, {"mean": -0.03})
    cutting.learn_back_off({"mean": 0.01}, {"mean": 0.0})
    assert cutting.back_off == {"mean": pytest.approx(0.18)}


def test_the_number_of_cuts_is_bounded_and_those_with_the_most_slack_go(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem()))
    cutting, draws = evaluator.cutting, evaluator.fresh("checks", 0, 3).scenarios
    for _ in range(3):
        cutting.add_draws(draws, [0.1, 0.3, 0.2])
    violations = {number: -float(number) for number in cutting.cuts}
    cutting.drop_draws(violations)
    assert len(cutting.cuts) == FEW.cuts
    assert list(cutting.cuts) == list(range(4, 4 + FEW.cuts))


def test_checks_take_at_most_their_share_of_the_rollouts(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem()))
    random = np.random.default_rng(0)
    for _ in range(12):
        evaluator.evaluate(loads(evaluator, random.uniform(800, 2400, 8).tolist()))
        assert evaluator.check_rollouts <= FEW.check_share * evaluator.rollouts
    assert evaluator.check_rollouts >= FEW.chunk


def test_a_stopped_run_makes_no_leader(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem()))
    evaluator.evaluate(loads(evaluator, [1500, 1600]))
    leader = evaluator.leader()
    assert leader is not None
    run = leader.runs[0]
    metrics = {name: np.full((1, 1), np.nan) for name in run.metrics}
    leader.runs[0] = RunOutcomes(np.full((1, 1), "diverged"), np.zeros((1, 1)), metrics)
    evaluator.refresh([leader])
    second = evaluator.leader()
    assert second is not None
    assert second.candidate != leader.candidate
