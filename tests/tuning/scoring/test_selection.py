"""The choice of the best: in scenarios of their own, never worse than the start, scored in others never seen."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import pytest

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import HELD_OUT, MARGIN, SELECTION
from dualwinch.tuning.scoring import selection
from dualwinch.tuning.scoring import validation as rounds
from dualwinch.tuning.scoring.config import SampleSizes
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.selection import NOT_CHOSEN, RANGE, judge
from dualwinch.tuning.scoring.training_set import ScenarioChoice, TrainingSet, prepare
from dualwinch.tuning.scoring.validation import FeasibilityScreen, Validated
from dualwinch.tuning.storage.memory import MemoryStorage
from dualwinch.tuning.storage.store import SearchBudget
from dualwinch.tuning.study import search
from tests.tuning.conftest import MakeProblem

SMALL = SampleSizes(
    finalists=6, sieved=100, draws=5, vertices=3, hard=2, looked_at=20, last=2, last_draws=7, confirmed=9, held_out=20
)

BETA = "controller.nftsm.beta"


def studied(evaluator: Evaluator, trials: int) -> list[Evaluation]:
    store = MemoryStorage(SearchBudget(trials))
    search("cmaes", optimiser("cmaes", evaluator.prepared, 0), store, evaluator)
    return store.finished()


def worse(prepared: TrainingSet) -> list[Candidate]:
    """Candidates with more error than the start."""
    start = prepared.problem.start
    return [Candidate(start | {BETA: share * float(start[BETA])}, "x") for share in (0.2, 0.3, 0.5)]


def test_the_best_is_chosen_and_scored_in_scenarios_of_their_own(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem(scenarios=2))
    problem, evaluator = prepared.problem, Evaluator(prepared)
    trials = studied(evaluator, 32)
    before = evaluator.rollouts
    verdict = judge(evaluator, trials, SMALL)
    assert evaluator.rollouts - before <= SMALL.rollouts

    def seeds(scenarios: Iterable[Experiment | Scenario]) -> set[object]:
        return {each.draws["simulation.seed"] for each in scenarios if isinstance(each, Scenario)}

    assert problem.ensemble
    ours = [
        seeds((*prepared.scenarios, *prepared.stress)),
        seeds(problem.ensemble.scenarios(12, problem.seed + SELECTION)),
    ]
    ours.append(seeds(problem.drawn(20, problem.seed + HELD_OUT)))
    assert len(set.union(*ours)) == sum(map(len, ours))
    assert verdict.improved
    assert verdict.selection is not None
    assert verdict.selection.scenarios == SMALL.last_draws
    assert verdict.held_out
    assert {name: score.evaluation.scenarios for name, score in verdict.scores.items()} == dict.fromkeys(
        ("best", "start", "paper"), 20
    )
    assert verdict.shown == ("best", "start", "paper")
    assert verdict.improvement("mean.mse") > 1
    assert verdict.improvement("mean.mse", "start") > 1
    assert verdict.within_authority.all()  # in 0.1 s nothing is asked for
    assert verdict.improvement_within_authority() == pytest.approx(verdict.improvement("mean.mse"))


def test_a_share_of_the_papers_is_one_of_what_it_reaches_in_the_same_scenarios(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2, constraints=["mean.chatter<=0.8*paper"])))
    verdict = judge(evaluator, studied(evaluator, 16), SMALL)
    (there,), (tuned,) = verdict.constraints, evaluator.prepared.constraints
    assert there.bound == pytest.approx(0.8 * verdict.statistics("paper")["mean.chatter"], rel=1e-12)
    assert there.bound != pytest.approx(tuned.bound, rel=1e-3)
    assert verdict.scores["paper"].evaluation.violations[there.label] == pytest.approx(0.25, rel=1e-9)


@pytest.mark.parametrize("ensemble", ["sea", None])
def test_gains_worse_than_the_start_are_never_the_best(ensemble: str | None, make_problem: MakeProblem) -> None:
    words = {} if ensemble else {"case": 4}
    prepared = prepare(make_problem(ensemble=ensemble, space=[BETA], constraints=[], **words))
    evaluator = Evaluator(prepared, prune=False)
    trials = evaluator.evaluate(worse(prepared))
    start = evaluator.start()
    assert min(trial.objectives for trial in trials) > start.objectives
    verdict = judge(evaluator, trials, SMALL)
    assert not verdict.improved
    assert verdict.obstacle == NOT_CHOSEN
    assert verdict.best == start
    assert verdict.scores["best"] == verdict.scores["start"]
    assert "start" not in verdict.shown


def test_the_start_is_kept_where_it_is_better_in_the_held_out_scenarios(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared = prepare(make_problem(scenarios=2))
    evaluator = Evaluator(prepared)
    trials = studied(evaluator, 32)
    beats = selection.improves_on
    monkeypatch.setattr(
        selection, "improves_on", lambda ours, start: ours.scenarios != SMALL.held_out and beats(ours, start)
    )
    verdict = judge(evaluator, trials, SMALL)
    assert "but not in the held-out scenarios" in verdict.obstacle
    assert verdict.best.point == prepared.problem.start
    assert verdict.selection is None
    assert verdict.scored == verdict.scores["start"].evaluation


def test_who_does_not_hold_where_scored_is_passed_over_for_the_next(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials = studied(evaluator, 32)
    leader = judge(evaluator, trials, SMALL).best
    beats = selection.improves_on

    def unless_scored(ours: Evaluation, start: Evaluation) -> bool:
        return beats(ours, start) and not (ours.point == leader.point and ours.scenarios == SMALL.held_out)

    monkeypatch.setattr(selection, "improves_on", unless_scored)
    verdict = judge(evaluator, trials, SMALL)
    assert verdict.improved
    assert verdict.passed_over == (leader.number,)
    assert verdict.best.point != leader.point
    assert verdict.improvement("mean.mse", "start") > 1


def test_the_start_and_the_papers_gains_are_one_where_they_do_the_same(make_problem: MakeProblem) -> None:
    settings = ["simulation.duration=0.1", "controller.estimator=none"]
    prepared = prepare(make_problem(settings=settings, scenarios=2))
    evaluator = Evaluator(prepared)
    verdict = judge(evaluator, studied(evaluator, 32), SMALL)
    assert verdict.start_is_papers
    assert verdict.shown == ("best", "paper")


def test_overwhelming_vertices_count_unless_only_far_worse_trials_hold_there(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials = studied(evaluator, 32)
    usual = judge(evaluator, trials, SMALL).best  # in 0.1 s nothing overwhelms the motors
    beyond, held = ScenarioChoice(10_000, vertex=True, hard=True), selection.screened
    monkeypatch.setattr(rounds, "beyond_authority", lambda *_: [beyond])

    def best_where(holds: Callable[[Evaluation], bool]) -> Evaluation:
        """The best where some trials alone hold against the overwhelming vertex."""

        def those(
            ours: Evaluator, sieve: FeasibilityScreen, given: Sequence[Evaluation], margin: float
        ) -> list[Validated]:
            overwhelmed = any(scenario.vertex and scenario.index == beyond.index for scenario in sieve.scenarios)
            return [(trial, met) for trial, met in held(ours, sieve, given, margin) if not overwhelmed or holds(trial)]

        monkeypatch.setattr(selection, "screened", those)
        return judge(evaluator, trials, SMALL).best

    least = min(trial.objectives[0] for trial in trials if trial.feasible)
    assert best_where(lambda _: False).point == usual.point
    assert best_where(lambda trial: trial.objectives[0] > RANGE * least).point == usual.point
    assert best_where(lambda trial: trial.point != usual.point).point != usual.point


def test_who_keeps_to_all_bounds_may_be_the_best_however_near_it_comes_to_them(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials = studied(evaluator, 32)
    leader = judge(evaluator, trials, SMALL).best

    def best_with(violation: float) -> Evaluation:
        """The best where the leader misses the distance from a bound that a search asks for."""
        seen = [
            replace(trial, violations=trial.violations | {"worst.peak_tension": violation})
            if trial.point == leader.point
            else trial
            for trial in trials
        ]
        return judge(evaluator, seen, SMALL).best

    assert best_with(0.9 * MARGIN).point == leader.point
    assert best_with(1.1 * MARGIN).point != leader.point


def test_who_came_near_a_bound_in_the_first_round_is_as_near_in_the_last() -> None:
    def met(peak: float, chatter: float) -> Evaluation:
        violations = {"worst.peak_tension <= 6000 N": peak, f"mean.chatter <= {9 + chatter:g} N": chatter}
        return Evaluation(Candidate({}, ""), (1.0,), violations, {}, {}, 1)

    (peak, chatter) = selection._as_near(met(-0.02, -0.5), met(-0.001, -0.1)).violations.values()
    assert (peak, chatter) == (-0.001, -0.5), "bounds that are a share of the paper's are others elsewhere"
    assert selection._as_near(met(-0.02, 0.0), met(0.3, 0.0)).reserve == 0, "what it broke before is not broken here"
