"""The choice of the best: in scenarios of their own, never worse than the start, scored in others never seen."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import CHANCE, TEST, VALIDATION
from dualwinch.tuning.scoring import screening, selection, test_set
from dualwinch.tuning.scoring.chance import ChanceConstraint
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.screening import Screening, Validated, before_the_start
from dualwinch.tuning.scoring.selection import CONTRADICTED, NOT_CHOSEN, select
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.scoring.validation import Screened, ValidationSet, validation_scenarios
from dualwinch.tuning.selection_config import SampleSizes, SelectionConfig
from dualwinch.tuning.storage.store import MemoryStorage
from dualwinch.tuning.study import SearchBudget, search
from tests.studies import MakeProblem

SMALL = SampleSizes(
    candidates=6,
    screening_rollouts=100,
    draws=9,
    vertices=3,
    chance=12,
    test=20,
)

BETA = "controller.nftsm.beta"


def studied(evaluator: Evaluator, trials: int) -> list[Evaluation]:
    store = MemoryStorage()
    search("cmaes", optimiser("cmaes", evaluator.training, 0), store, evaluator, SearchBudget(trials))
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
    most = (
        SMALL.screening_rollouts
        + 2 * SMALL.candidates * 12
        + 2 * 12
        + SelectionConfig.chance_candidates * (12 + 4 * 12)
        + 60
    )
    assert evaluator.rollouts - before <= most

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
    assert 0 < verdict.validation.scenarios <= SMALL.draws + SMALL.vertices
    assert verdict.chance is not None
    assert verdict.chance.draws == SMALL.chance
    assert verdict.has_test_set
    assert {name: score.evaluation.scenarios for name, score in verdict.scores.items()} == dict.fromkeys(
        ("best", "start", "paper"), 20
    )
    assert verdict.shown == ("best", "start", "paper")
    assert verdict.improvement("mean.mse") > 1
    assert verdict.improvement("mean.mse", "start") > 1
    assert verdict.within_authority.all()  # in 0.1 s nothing is asked for
    assert verdict.improvement("mean.mse", feasible=True) == verdict.improvement("mean.mse")


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


class MadeUp(ValidationSet):
    """A validation set in which the highest peak is what the reserve leaves of a force."""

    def __init__(self, evaluator: Evaluator, highest: float) -> None:
        super().__init__(evaluator, validation_scenarios(evaluator.training.problem, SMALL))
        self._highest = highest

    def screen(self, candidates: Sequence[Candidate]) -> list[Screened]:
        found = []
        for candidate in candidates:
            excess = (self._highest - float(candidate.point[RESERVE])) / BOUND - 1
            result = Evaluation(candidate, (1.0,), {LABEL: excess}, {}, {}, 1)
            found.append(Screened(result if excess <= 0 else None, {LABEL: excess}))
        return found


BOUND, LABEL = 6000.0, "worst.peak_tension <= 6000 N"


@pytest.fixture
def bounded(make_problem: MakeProblem) -> Evaluator:
    bounds = [f"worst.peak_tension<={BOUND:g}"]
    return Evaluator(prepare(make_problem(space=[f"{RESERVE}=0:225"], constraints=bounds)))


def screening_of(
    evaluator: Evaluator, validation: ValidationSet, trials: Sequence[Evaluation], sizes: SampleSizes = SMALL
) -> Screening:
    return Screening(evaluator, validation, trials, evaluator.start(), sizes)


def trial(reserve: float, number: int, violation: float = -0.2) -> Evaluation:
    return Evaluation(Candidate({RESERVE: reserve}, "x"), (1.0,), {LABEL: violation}, {}, {}, 1, number=number)


def test_a_group_gives_its_feasible_candidates_and_repaired_ones_and_the_bounds_that_others_violate(
    bounded: Evaluator,
) -> None:
    trials = [trial(80, 4), trial(180, 7)]
    found, violated = screening_of(bounded, MadeUp(bounded, 6100.0), trials).screened(trials)
    assert [(each.trial.number, round(float(each.trial.point[RESERVE]), 6)) for each in found] == [(7, 180), (4, 130)]
    assert violated == {LABEL}
    found, violated = screening_of(bounded, MadeUp(bounded, 6500.0), trials).screened(trials)
    assert found == []
    assert violated == {LABEL}


def test_the_next_group_keeps_twice_the_distance_from_a_bound_that_the_last_one_violated(
    bounded: Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    groups = list[list[int]]()

    def screened(_: Screening, group: Sequence[Evaluation]) -> tuple[list[Validated], set[str]]:
        groups.append([each.number for each in group])
        return [], {LABEL} if len(groups) < 3 else set()

    monkeypatch.setattr(Screening, "screened", screened)
    near = [trial(100 + number, number, violation=-0.001 * number) for number in range(40)]
    validation = ValidationSet(bounded, validation_scenarios(bounded.training.problem, SMALL))
    screening_of(bounded, validation, near, replace(SMALL, candidates=4, screening_rollouts=10_000)).following()
    assert groups[0] == [0, 1, 2, 3]
    assert groups[1] == [5, 6, 7, 8], "1 % from the bound, half of which training has asked for"
    assert groups[2] == [15, 16, 17, 18], "2 %"
    assert groups[9:11] == [[4, 10, 12, 14], [9]], "where none keeps it, every second, then every fourth"
    assert sorted(number for group in groups for number in group) == list(range(40)), "each once"


def test_draws_in_which_a_candidate_violated_a_bound_rule_out_others_that_do_and_stay_in_the_validation_set(
    make_problem: MakeProblem,
) -> None:
    free = Evaluator(prepare(make_problem(scenarios=2)))
    problem = free.training.problem
    calm, rough = (Candidate(problem.start | {"controller.coordination.preload": load}, "x") for load in (2e3, 9e3))
    draws = [each for each in problem.drawn(3, problem.stream(CHANCE)) if isinstance(each, Scenario)]
    low, high = free.run([calm, rough], draws).metrics["peak_tension"]
    assert low.max() < high.min()
    bound = f"worst.peak_tension<={(low.max() + high.min()) / 2}"
    evaluator = Evaluator(prepare(make_problem(scenarios=2, constraints=[bound])))
    validation = ValidationSet(evaluator, validation_scenarios(problem, SMALL))
    before = len(validation.scenarios)
    screening = screening_of(evaluator, validation, [])
    both = [Validated(each, each) for each in evaluator.over([rough, calm], draws, training=True)]
    assert screening.learn(draws, both) == both[1:]
    assert [scenario.index for scenario in validation.scenarios[before:]] == [draw.index for draw in draws]
    assert all(scenario.hard for scenario in validation.scenarios[before:]), "a mean is that of the set as it was drawn"
    assert screening.learn([], both) == both
    early, _ = validation.screen([rough, calm])
    assert early.result is None
    assert early.excess > 0


def test_without_a_feasible_candidate_the_one_that_violates_bounds_in_the_fewest_scenarios_is_the_choice(
    make_problem: MakeProblem,
) -> None:
    free = Evaluator(prepare(make_problem(scenarios=2)))
    validation = validation_scenarios(free.training.problem, SMALL)
    candidates = [each.candidate for each in studied(free, 32)]
    peaks = free.run(candidates, validation).metrics["peak_tension"]
    bound = 0.999 * peaks.max(axis=1).min()
    evaluator = Evaluator(prepare(make_problem(scenarios=2, constraints=[f"worst.peak_tension<={bound}"])), prune=False)
    verdict = select(evaluator, evaluator.evaluate(candidates), SMALL)
    fewest = (peaks > bound).sum(axis=1)
    assert 0 < fewest.min() < fewest.max()
    assert verdict.validation is not None
    assert verdict.validation.violated == fewest[candidates.index(verdict.best.candidate)]
    assert verdict.validation.violated <= np.median(fewest)


def test_a_violation_that_is_as_rare_as_fresh_draws_support_is_no_contradiction(make_problem: MakeProblem) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    scores = select(evaluator, studied(evaluator, 32), SMALL).scores
    best = scores["best"].feasible
    rare = scores | {"best": replace(scores["best"], feasible=replace(best, violations={LABEL: 0.1}, violated=1))}
    chance = ChanceConstraint(0.005, 0.95, 3, 819, 0)
    assert selection._contradiction(rare, None) == CONTRADICTED
    assert selection._contradiction(rare, chance) == ""
    often = replace(rare["best"].feasible, violated=best.scenarios // 2)
    frequent = rare | {"best": replace(scores["best"], feasible=often)}
    assert selection._contradiction(frequent, chance) == selection.PROBABILITY_CONTRADICTED


def test_means_of_the_choice_and_of_the_first_line_are_those_over_feasible_scenarios(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scenario that asks for more force than there is counts in the worst case, and in the means over all."""
    within = np.arange(SMALL.test) != 3
    monkeypatch.setattr(test_set, "within_authority", lambda scenarios: within[: len(scenarios)])
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    verdict = select(evaluator, studied(evaluator, 32), SMALL)
    for score in verdict.scores.values():
        errors = score.result.metrics["mse"][0]
        assert score.evaluation.statistics["mean.mse"] == pytest.approx(errors.mean(), rel=1e-12)
        assert score.feasible.statistics["mean.mse"] == pytest.approx(errors[within].mean(), rel=1e-12)
        for name in ("worst.peak_tension", "worst.min_tension"):
            assert score.feasible.statistics[name] == score.evaluation.statistics[name]
    assert verdict.feasible_scenarios == SMALL.test - 1
    best = verdict.scores["best"]
    worse_in_all = replace(best, evaluation=replace(best.evaluation, objectives=(1.0,)))
    assert selection._contradiction(verdict.scores | {"best": worse_in_all}, verdict.chance) == ""
    worse_in_feasible = replace(best, feasible=replace(best.feasible, objectives=(1.0,)))
    assert selection._contradiction(verdict.scores | {"best": worse_in_feasible}, verdict.chance) == CONTRADICTED


def violating(counts: Sequence[int], draws: int) -> Callable[[BatchResult, object], np.ndarray]:
    """Violations of candidates in so many fresh draws, each in as many as its count says; none in other scenarios."""
    waiting = iter(counts)

    def worst_of(result: BatchResult, _: object) -> np.ndarray:
        values = np.full(result.outcomes.shape, -1.0)
        if result.outcomes.shape[1] == draws:
            values[0, : next(waiting)] = 1.0
        return values

    return worst_of


def test_candidates_are_confirmed_in_draws_of_their_own_until_one_violates_nothing(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials = studied(evaluator, 32)
    seen, run, sizes = list[set[int]](), evaluator.run, replace(SMALL, chance=13)

    def running(candidates: Sequence[Candidate], scenarios: Sequence[Scenario], **words: bool) -> BatchResult:
        if len(scenarios) == sizes.chance:
            seen.append({scenario.index for scenario in scenarios})
        return run(candidates, scenarios, **words)

    monkeypatch.setattr(evaluator, "run", running)
    monkeypatch.setattr(selection, "worst_of", violating([3, 1, 0], sizes.chance))
    verdict = select(evaluator, trials, sizes)
    assert verdict.chance is not None
    assert verdict.chance.violations == 0
    assert len(seen) == 3
    assert len(set.union(*seen)) == 3 * sizes.chance
    monkeypatch.setattr(selection, "worst_of", violating([3, 1, 2], sizes.chance))
    verdict = select(evaluator, trials, sizes)
    assert verdict.chance is not None
    assert verdict.chance.violations == 1, "of those that all violate something the fewest"


def test_a_better_candidate_that_the_chance_constraint_rules_out_is_named(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(prepare(make_problem(scenarios=2)))
    trials, sizes = studied(evaluator, 32), replace(SMALL, chance=13)
    monkeypatch.setattr(selection, "worst_of", violating([3, 0], sizes.chance))
    monkeypatch.setattr(screening, "worst_of", lambda result, _: np.ones(result.outcomes.shape))  # so do all others
    monkeypatch.setattr(Screening, "_group", one_group(Screening._group))
    verdict = select(evaluator, trials, sizes)
    assert not verdict.improved
    assert verdict.obstacle.startswith(f"{NOT_CHOSEN}; trial ")
    assert "reaches mean.mse = " in verdict.obstacle
    assert verdict.obstacle.endswith("but violates bounds in 3 of 13 fresh draws")


def one_group(original: Callable[[Screening], list[Evaluation]]) -> Callable[[Screening], list[Evaluation]]:
    """The first group of a screening, and no more."""
    return lambda self: [] if self._tried else original(self)


@pytest.mark.parametrize(("violated", "kept"), [(1, []), (20, [7, 8])], ids=["rarely", "often"])
def test_a_far_better_start_that_rarely_violates_a_bound_is_not_given_up_for_a_feasible_trial(
    violated: int, kept: list[int]
) -> None:
    start = replace(trial(0, 0, violation=0.02), objectives=(0.5,), scenarios=100, violated=violated)
    found = [Validated(each, each) for each in (trial(180, 7), replace(trial(180, 8), objectives=(2.0,)))]
    ordered = before_the_start(found, Validated(start, start), SelectionConfig.penalty)
    assert [each.trial.number for each in ordered] == kept
    assert [each.trial.number for each in before_the_start(found, None, SelectionConfig.penalty)] == [7, 8]


def test_a_start_that_violates_a_bound_on_a_mean_takes_no_part(
    bounded: Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    validation = ValidationSet(bounded, validation_scenarios(bounded.training.problem, SMALL))
    start = bounded.start()
    assert screening_of(bounded, validation, []).start is not None
    too_rough = replace(start, violations=start.violations | {"mean.chatter <= 4 N": 0.1})
    monkeypatch.setattr(bounded, "over", lambda *_, **__: [too_rough])
    assert screening_of(bounded, validation, []).start is None
