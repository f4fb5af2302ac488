"""The choice of the best: in scenarios of their own, never worse than the start, scored in others never seen."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import pytest

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import CHANCE, TEST, VALIDATION
from dualwinch.tuning.scoring import selection
from dualwinch.tuning.scoring import validation as rounds
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.selection import CONTRADICTED, NOT_CHOSEN, select
from dualwinch.tuning.scoring.training_set import ScenarioChoice, TrainingSet, prepare
from dualwinch.tuning.scoring.validation import FeasibilityScreen, Validated
from dualwinch.tuning.selection_config import SampleSizes, SelectionConfig
from dualwinch.tuning.storage.store import MemoryStorage, SearchBudget
from dualwinch.tuning.study import search
from tests.tuning.conftest import MakeProblem

SMALL = SampleSizes(
    candidates=6,
    screening_rollouts=100,
    draws=5,
    vertices=3,
    hard_draws=2,
    hard_among=20,
    second_candidates=2,
    second_draws=7,
    further_draws=9,
    test=20,
    chance=15,
)

BETA = "controller.nftsm.beta"


def studied(evaluator: Evaluator, trials: int) -> list[Evaluation]:
    store = MemoryStorage(SearchBudget(trials))
    search("cmaes", optimiser("cmaes", evaluator.training, 0), store, evaluator)
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
    verdict = select(evaluator, trials, SMALL)
    assert evaluator.rollouts - before <= SMALL.rollouts

    def seeds(scenarios: Iterable[Experiment | Scenario]) -> set[object]:
        return {each.draws["simulation.seed"] for each in scenarios if isinstance(each, Scenario)}

    assert problem.ensemble
    ours = [
        seeds((*prepared.scenarios, *prepared.hard)),
        seeds(problem.ensemble.scenarios(12, problem.stream(VALIDATION))),
    ]
    ours += [seeds(problem.drawn(20, problem.stream(name))) for name in (CHANCE, TEST)]
    assert len(set.union(*ours)) == sum(map(len, ours))
    assert verdict.improved
    assert verdict.validation is not None
    assert verdict.validation.scenarios == SMALL.second_draws
    assert verdict.has_test_set
    assert verdict.chance is not None
    assert verdict.chance.draws == SMALL.chance
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
    verdict = select(evaluator, studied(evaluator, 16), SMALL)
    (there,), (tuned,) = verdict.constraints, evaluator.training.constraints
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
    verdict = select(evaluator, trials, SMALL)
    assert not verdict.improved
    assert verdict.obstacle == NOT_CHOSEN
    assert verdict.best == start
    assert verdict.scores["best"] == verdict.scores["start"]
    assert "start" not in verdict.shown


def test_the_test_set_never_chooses_and_a_contradiction_is_said(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials = studied(evaluator, 32)
    chosen = select(evaluator, trials, SMALL)
    assert chosen.contradiction == ""
    improves, tested = selection.improves_on, list[Evaluation]()

    def unless_tested(ours: Evaluation, start: Evaluation) -> bool:
        tested.extend([ours] * (ours.scenarios == SMALL.test))
        return improves(ours, start) and ours.scenarios != SMALL.test

    monkeypatch.setattr(selection, "improves_on", unless_tested)
    again = select(evaluator, trials, SMALL)
    assert again.best == chosen.best, "whatever the test set says"
    assert again.improved
    assert again.contradiction == CONTRADICTED
    assert [each.point for each in tested] == [chosen.best.point], "the test set is evaluated once, for the choice"
    assert again.scores["best"].evaluation == chosen.scores["best"].evaluation


def test_the_start_and_the_papers_gains_are_one_where_they_do_the_same(make_problem: MakeProblem) -> None:
    settings = ["simulation.duration=0.1", "controller.estimator=none"]
    prepared = prepare(make_problem(settings=settings, scenarios=2))
    evaluator = Evaluator(prepared)
    verdict = select(evaluator, studied(evaluator, 32), SMALL)
    assert verdict.start_is_papers
    assert verdict.shown == ("best", "paper")


def test_overwhelming_vertices_count_unless_only_far_worse_trials_hold_there(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials = studied(evaluator, 32)
    usual = select(evaluator, trials, SMALL).best  # in 0.1 s nothing overwhelms the motors
    beyond, held = ScenarioChoice(10_000, vertex=True, hard=True), selection.screened
    monkeypatch.setattr(rounds, "beyond_authority", lambda *_: [beyond])

    def best_where(holds: Callable[[Evaluation], bool]) -> Evaluation:
        """The best where some trials alone hold against the overwhelming vertex."""

        def those(
            ours: Evaluator, screen: FeasibilityScreen, given: Sequence[Evaluation], margin: float
        ) -> list[Validated]:
            overwhelmed = any(scenario.vertex and scenario.index == beyond.index for scenario in screen.scenarios)
            return [(trial, met) for trial, met in held(ours, screen, given, margin) if not overwhelmed or holds(trial)]

        monkeypatch.setattr(selection, "screened", those)
        return select(evaluator, trials, SMALL).best

    least = min(trial.objectives[0] for trial in trials if trial.feasible)
    assert best_where(lambda _: False).point == usual.point
    assert best_where(lambda trial: trial.objectives[0] > SelectionConfig.authority_price * least).point == usual.point
    assert best_where(lambda trial: trial.point != usual.point).point != usual.point


def test_who_keeps_to_all_bounds_may_be_the_best_however_near_it_comes_to_them(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2, selection=SelectionConfig())))
    trials = studied(evaluator, 32)
    leader = select(evaluator, trials, SMALL).best

    def best_with(violation: float) -> Evaluation:
        """The best where the leader misses the distance from a bound that a search asks for."""
        seen = [
            replace(trial, violations=trial.violations | {"worst.peak_tension": violation})
            if trial.point == leader.point
            else trial
            for trial in trials
        ]
        return select(evaluator, seen, SMALL).best

    assert best_with(0.9 * SelectionConfig.back_off).point == leader.point
    assert best_with(1.1 * SelectionConfig.back_off).point != leader.point


def test_who_came_near_a_bound_in_the_first_round_is_as_near_in_the_last() -> None:
    def met(peak: float, chatter: float) -> Evaluation:
        violations = {"worst.peak_tension <= 6000 N": peak, f"mean.chatter <= {9 + chatter:g} N": chatter}
        return Evaluation(Candidate({}, ""), (1.0,), violations, {}, {}, 1)

    (peak, chatter) = selection._least_clearance(met(-0.02, -0.5), met(-0.001, -0.1)).violations.values()
    assert (peak, chatter) == (-0.001, -0.5), "bounds that are a share of the paper's are others elsewhere"
    assert selection._least_clearance(met(-0.02, 0.0), met(0.3, 0.0)).clearance == 0, (
        "what it broke before is not broken here"
    )
