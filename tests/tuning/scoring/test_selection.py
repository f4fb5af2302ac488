"""The choice of the best: certified in fresh draws, never a worse one than the start, scored in others never seen."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.scoring import clock, selection, test_set
from dualwinch.tuning.scoring.budget import SelectionBudget
from dualwinch.tuning.scoring.certificate import SampleCertificate
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.selection import NOT_CHOSEN, Certification, select
from dualwinch.tuning.scoring.test_set import SelectionResult
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.storage.store import MemoryStorage
from dualwinch.tuning.study import Search, SearchBudget
from tests.studies import FEW, MakeProblem

BETA = "controller.nftsm.beta"
STAGE = SampleCertificate(FEW.violation, FEW.confidence).draws_of_stage(0)


def studied(evaluator: Evaluator, trials: int = 32) -> list[Evaluation]:
    store = MemoryStorage()
    Search("cmaes", optimiser("cmaes", evaluator.training, 0), store, evaluator).run(SearchBudget(trials))
    return store.finished()


def examined(
    evaluator: Evaluator, trials: Sequence[Evaluation], budget: SelectionBudget | None = None
) -> Certification:
    """A certification that has been run on finished trials."""
    certification = Certification(evaluator)
    certification.add(trials)
    certification.run(budget or SelectionBudget())
    return certification


def worse(prepared: TrainingSet) -> list[Candidate]:
    """Candidates with more error than the start."""
    start = prepared.problem.start
    return [Candidate(start | {BETA: share * float(start[BETA])}, "x") for share in (0.2, 0.3, 0.5)]


def violating(counts: Sequence[int], draws: int) -> Callable[[BatchResult, object], np.ndarray]:
    """Violations of candidates in fresh draws, each in as many of its first ones as its count says."""
    waiting = iter(counts)

    def worst_of(result: BatchResult, _: object) -> np.ndarray:
        values = np.full(result.outcomes.shape, -1.0)
        if result.outcomes.shape[1] == draws:
            values[0, : next(waiting)] = 1.0
        return values

    return worst_of


Study = Callable[..., tuple[Evaluator, list[Evaluation]]]


@pytest.fixture
def violating_study(make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch) -> Study:
    """``violating_study([STAGE, 0])``: a study whose candidates violate bounds in so many fresh draws, one by one."""

    def study(counts: Sequence[int], draws: int = STAGE, penalty: float = FEW.penalty, **words: Any) -> Any:
        options = replace(FEW, chunk=draws, penalty=penalty)
        evaluator = Evaluator(prepare(make_problem(scenarios=2, options=options, **words)))
        trials = studied(evaluator)
        monkeypatch.setattr(selection, "worst_of", violating(counts, draws))
        return evaluator, trials

    return study


def selected(evaluator: Evaluator, trials: Sequence[Evaluation]) -> SelectionResult:
    """The choice among trials, all of which may be examined."""
    return select(evaluator, trials, examined(evaluator, trials))


def test_the_best_is_certified_and_scored_in_draws_of_their_own(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials, seen, run = studied(evaluator), list[object](), evaluator.run

    def running(candidates: Sequence[Candidate], scenarios: Sequence[Scenario], **words: bool) -> BatchResult:
        if candidates and candidates[0] == verdict_candidate(evaluator):
            seen.extend(scenario.draws["simulation.seed"] for scenario in scenarios)
        return run(candidates, scenarios, **words)

    monkeypatch.setattr(evaluator, "run", running)
    verdict = selected(evaluator, trials)
    assert len(set(seen)) == len(seen) == STAGE + FEW.test
    assert verdict.improved
    assert verdict.certificate is not None
    assert verdict.certificate.satisfied
    assert verdict.certificate.draws == STAGE
    assert verdict.examined == 1
    assert {name: score.evaluation.scenarios for name, score in verdict.scores.items()} == dict.fromkeys(
        ("best", "start", "paper"), FEW.test
    )
    assert verdict.shown == ("best", "start", "paper")
    assert verdict.improvement("mean.mse") > 1
    assert verdict.improvement("mean.mse", "start") > 1
    assert verdict.within_authority.all()  # in 0.1 s nothing is asked for
    errors = verdict.scores["best"].result.metrics["mse"][0]
    for kind, expected in (
        ("mean", errors.mean()),
        ("geomean", np.prod(errors / errors[0]) ** (1 / FEW.test) * errors[0]),
    ):
        mean, low, high = verdict.mean_interval(Statistic(kind, "mse"), 0.95) or (np.nan, np.nan, np.nan)
        assert mean == pytest.approx(expected, rel=1e-9)
        assert errors.min() < low < mean < high < errors.max()
    assert verdict.mean_interval(Statistic("median", "mse"), 0.95) is None
    assert verdict.improvement("mean.mse", feasible=True) == verdict.improvement("mean.mse")


def verdict_candidate(evaluator: Evaluator) -> Candidate:
    """The leader of a search before any is examined."""
    entries = [entry for entry in evaluator.archive.values() if entry.complete]
    return min(entries, key=lambda entry: selection.merit(entry.evaluation)).candidate


@pytest.mark.parametrize("reference", ["paper", "start"])
def test_a_share_of_other_gains_is_one_of_what_they_reach_in_the_same_scenarios(
    reference: str, make_problem: MakeProblem
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2, constraints=[f"mean.chatter<=0.8*{reference}"])))
    verdict = selected(evaluator, studied(evaluator, 16))
    (there,), (tuned,) = verdict.constraints, evaluator.training.constraints
    assert there.bound == pytest.approx(0.8 * verdict.statistics(reference)["mean.chatter"], rel=1e-12)
    assert there.bound != pytest.approx(tuned.bound, rel=1e-3)
    assert verdict.scores[reference].evaluation.violations[there.label] == pytest.approx(0.25, rel=1e-9)


@pytest.mark.parametrize("ensemble", ["sea", None])
def test_gains_worse_than_the_start_are_never_the_best(ensemble: str | None, make_problem: MakeProblem) -> None:
    words = {} if ensemble else {"case": 4}
    prepared = prepare(make_problem(ensemble=ensemble, space=[BETA], constraints=[], **words))
    evaluator = Evaluator(prepared)
    trials = evaluator.evaluate(worse(prepared))
    start = evaluator.start()
    assert min(trial.objectives for trial in trials) > start.objectives
    verdict = select(evaluator, trials, examined(evaluator, trials) if ensemble else None)
    assert not verdict.improved
    assert verdict.obstacle == (NOT_CHOSEN if ensemble is None else selection.NONE_BEFORE)
    assert verdict.best == start
    assert verdict.scores["best"] == verdict.scores["start"]
    assert "start" not in verdict.shown


def test_the_test_set_never_chooses_and_a_contradiction_is_said(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    verdict = selected(evaluator, studied(evaluator))
    assert verdict.contradiction == ""
    monkeypatch.setattr(selection, "improves_on", lambda *_: False)
    words = selection._contradiction(verdict.scores, verdict.certificate, verdict.constraints)
    assert words == selection.LESS_ERROR


def test_the_start_and_the_papers_gains_are_one_where_they_do_the_same(make_problem: MakeProblem) -> None:
    settings = ["simulation.duration=0.1", "controller.estimator=none"]
    evaluator = Evaluator(prepare(make_problem(settings=settings, scenarios=2)))
    verdict = selected(evaluator, studied(evaluator))
    assert verdict.start_is_papers
    assert verdict.shown == ("best", "paper")


def test_leaders_are_examined_in_order_until_one_is_certified(violating_study: Study) -> None:
    certification = examined(*violating_study([STAGE, STAGE, 0]))
    certified = certification.certified
    assert certified is not None
    assert [each.certificate.violations for each in certification.examined] == [STAGE, STAGE, 0]
    merits = [each.entry.evaluation.costs[0] for each in certification.examined]
    assert merits == sorted(merits), "none of their bounds is violated in training"
    assert certified.certificate.candidate == 3
    assert certified.certificate.error < SampleCertificate(FEW.violation, FEW.confidence).error


@pytest.mark.parametrize("violations", [1, 3])
def test_a_candidate_with_rare_violations_is_certified_in_more_draws(violations: int, violating_study: Study) -> None:
    """Three violations in a stage for none leave the probability open, too: draws go on until they support it."""
    certificate = SampleCertificate(FEW.violation, FEW.confidence, 1, STAGE, violations)
    assert not certificate.rejected
    needed = certificate.draws_of_stage(violations)
    certified = examined(*violating_study([violations, *[0] * (needed // STAGE)])).certified
    assert certified is not None
    assert (certified.certificate.violations, certified.certificate.draws) == (violations, needed)


@pytest.mark.parametrize(("constraint", "examinations"), [("mean.chatter<=9*paper", 1), ("mean.chatter<=1e9", 2)])
def test_a_budget_counts_the_runs_of_the_papers_gains_beside_a_candidate(
    constraint: str, examinations: int, violating_study: Study
) -> None:
    evaluator, trials = violating_study([STAGE, 0], constraints=[constraint])
    runs_of_paper = STAGE if "paper" in constraint else 0
    draws = 2.5 * SampleCertificate(FEW.violation, FEW.confidence, 2).draws_of_stage(0)
    budget = SelectionBudget(rollouts=evaluator.rollouts + runs_of_paper + round(draws))
    assert len(examined(evaluator, trials, budget).examined) == examinations


def test_the_reserve_for_runs_of_the_papers_gains_is_what_they_took_before(violating_study: Study) -> None:
    """A bound far away is settled at the first look, after which they do not run any more."""
    counts = [STAGE // 2, 0, 0, 0]
    evaluator, trials = violating_study(counts, STAGE // 2, constraints=["mean.chatter<=9*paper"])
    second = SampleCertificate(FEW.violation, FEW.confidence, 2).draws_of_stage(0)
    before = evaluator.rollouts
    certification = examined(evaluator, trials, SelectionBudget(rollouts=before + STAGE + second + STAGE // 2))
    assert len(certification.examined) == 2
    assert evaluator.rollouts - before < STAGE + 2 * second


def test_where_time_is_short_leaders_are_examined_as_long_as_it_lasts(violating_study: Study) -> None:
    """Draws that take a day leave no time for another certificate, nor for more search; the next leader is examined."""
    (evaluator, trials), day, hour = violating_study([STAGE, 0]), 86400.0, 3600.0
    evaluator.meter.draws.seconds += day
    certification = Certification(evaluator)
    certification.add(trials)
    searches = list[int]()
    certification.run(SelectionBudget(until=clock.without_compiling() + hour), lambda: searches.append(1))
    assert [each.certificate.violations for each in certification.examined] == [STAGE, 0]
    assert not searches


def test_without_rollouts_for_another_the_best_is_stated_with_its_probability(violating_study: Study) -> None:
    evaluator, trials = violating_study([1, 0], penalty=1.0)
    verdict = select(evaluator, trials, examined(evaluator, trials, SelectionBudget(rollouts=0)))
    assert verdict.improved
    assert verdict.certificate is not None
    assert not verdict.certificate.satisfied
    assert (verdict.certificate.violations, verdict.certificate.draws) == (1, STAGE)
    assert verdict.unexamined > 0


def test_a_leader_that_violates_bounds_in_most_draws_is_named_where_the_start_is_kept(violating_study: Study) -> None:
    evaluator, trials = violating_study([STAGE, 0])
    verdict = select(evaluator, trials, examined(evaluator, trials, SelectionBudget(rollouts=0)))
    assert not verdict.improved
    assert "reaches mean.mse = " in verdict.obstacle
    assert verdict.obstacle.endswith(f"in {STAGE} of {STAGE} fresh draws")
    assert verdict.certificate is not None
    assert verdict.certificate.violations == 0, "that of the start"


def test_a_violated_mean_is_a_rejection_and_keeps_that_bound_off(make_problem: MakeProblem) -> None:
    free = Evaluator(prepare(make_problem(scenarios=2)))
    start = [Candidate(free.problem.start, "start")]
    runs = [
        free.run(start, each).metrics
        for each in (free.training.scenarios, free.fresh("certificate", 0, STAGE).scenarios)
    ]
    means = {
        name: [of[name][0].mean() for of in runs] for name in ("mse", "chatter", "peak_tension", "continuous_load")
    }
    metric, bound = next((name, (here + there) / 2) for name, (here, there) in means.items() if there > here)
    evaluator = Evaluator(prepare(make_problem(scenarios=2, constraints=[f"mean.{metric}<={bound}"])))
    trials = evaluator.evaluate(start)
    certification = examined(evaluator, trials, SelectionBudget(rollouts=0))
    first = certification.examined[0]
    assert first.entry.evaluation.violations[evaluator.training.constraints[0].label] > 0, "by the back-off"
    assert not first.certificate.satisfied
    assert list(first.certificate.means) == [evaluator.training.constraints[0].label]
    assert evaluator.cutting.back_off[evaluator.training.constraints[0].label] > 0


def test_a_violation_that_is_as_rare_as_fresh_draws_support_is_no_contradiction(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2, constraints=["worst.peak_tension<=6000"])))
    verdict = selected(evaluator, studied(evaluator))
    scores, constraints = verdict.scores, verdict.constraints
    (label,) = (constraint.label for constraint in constraints)
    best = scores["best"].feasible
    rare = scores | {"best": replace(scores["best"], feasible=replace(best, violations={label: 0.1}, violated=1))}
    certificate = SampleCertificate(0.005, 0.95, 1, 797, 0)
    assert selection._contradiction(rare, None, constraints) == selection.LESS_VIOLATION
    assert selection._contradiction(rare, certificate, constraints) == ""
    often = replace(rare["best"].feasible, violated=best.scenarios // 2)
    frequent = rare | {"best": replace(scores["best"], feasible=often)}
    assert selection._contradiction(frequent, certificate, constraints) == selection.MORE_VIOLATIONS


def test_means_of_the_first_line_are_those_within_the_motors_authority(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scenario that asks for more force than there is counts in the worst case, and in the means over all."""
    within = np.arange(FEW.test) != 3
    monkeypatch.setattr(test_set, "with_authority", lambda *_: within)
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    verdict = selected(evaluator, studied(evaluator))
    for score in verdict.scores.values():
        errors = score.result.metrics["mse"][0]
        assert score.evaluation.statistics["mean.mse"] == pytest.approx(errors.mean(), rel=1e-12)
        assert score.feasible.statistics["mean.mse"] == pytest.approx(errors[within].mean(), rel=1e-12)
        for name in ("worst.peak_tension", "worst.min_tension"):
            assert score.feasible.statistics[name] == score.evaluation.statistics[name]
    assert verdict.feasible_scenarios == FEW.test - 1
