"""Tuning in one call: its phases, its time, what it says, and the figures of a study."""

import json
import math
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.reports.tuning import costs, next_steps
from dualwinch.tuning import tune as tuning
from dualwinch.tuning.optimisers import METHODS
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.plots import (
    before_and_after,
    best_gains,
    distributions,
    front,
    importance,
    importances,
)
from dualwinch.tuning.record import write_study
from dualwinch.tuning.result import (
    TuningCost,
    TuningResult,
    advice,
    authority,
    comparison,
    gains_at_bounds,
    headings,
    headline,
    short_of,
    times,
    too_short,
    widen,
    worth,
)
from dualwinch.tuning.scoring import clock, scorer
from dualwinch.tuning.scoring.certificate import SampleCertificate
from dualwinch.tuning.scoring.progress import (
    CERTIFYING,
    PHASES,
    SEARCHING,
    SearchStatus,
    TuningProgress,
)
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.scoring.scorer import FAILED
from dualwinch.tuning.scoring.test_set import SelectionResult
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.space import Point
from dualwinch.tuning.tune import trials_of, tune
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.studies import FEW, MakeProblem


class Recorded(TuningProgress):
    """A watch that remembers; interrupts once there are so many trials."""

    def __init__(self, interrupt_at: int = 10**9) -> None:
        super().__init__()
        self.phases: list[str] = []
        self.batches: list[tuple[str, float | None, int | None]] = []
        self._interrupt_at = interrupt_at

    def phase(self, words: str) -> None:
        self.phases.append(words)

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:
        self.batches.append((self.phases[-1], until, trials))
        if progress.trials >= self._interrupt_at:
            raise KeyboardInterrupt


class Stubborn:
    """An optimiser that proposes nothing but much error."""

    rollouts = 0

    def __init__(self, prepared: TrainingSet, seed: int) -> None:  # noqa: ARG002
        self._start = prepared.problem.start

    def ask(self, count: int) -> list[Point]:
        return [self._start | {"controller.nftsm.beta": 0.005 * (1 + number / 100)} for number in range(count)]

    def tell(self, evaluations: object) -> None:
        """Learn nothing."""


@pytest.fixture(scope="module")
def tuned(make_problem: MakeProblem) -> TuningResult:
    return tune(make_problem(), trials=96, test_scenarios=6)


def test_the_best_is_the_tuned_experiment_and_the_numbers_are_exact(tuned: TuningResult) -> None:
    assert [trial.number for trial in tuned.trials] == list(range(96))
    assert leaves(tuned.best)["controller.nftsm.beta"] == tuned.gains["controller.nftsm.beta"]
    assert tuned.verdict.has_test_set
    assert tuned.verdict.scored.scenarios == 6
    assert not tuned.interrupted


def test_a_notebook_and_a_prompt_show_what_was_found(tuned: TuningResult) -> None:
    shown = tuned._repr_html_()
    assert escape(headline(tuned)) in shown
    assert escape(worth(tuned)) in shown
    for key, value in tuned.gains.items():
        assert f">{key}</td>" in shown
        assert f"{value:.6g}</td>" in shown
    assert repr(tuned) == f"TuningResult({worth(tuned)}; {headline(tuned)})", "no scenario is beyond the authority"


def test_without_a_budget_there_are_as_many_trials_as_of_the_command(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert tuning.TRIALS == 1000
    monkeypatch.setattr(tuning, "TRIALS", 20)
    few = make_problem(options=replace(FEW, trials_per_gain=2))
    assert len(tune(few, test_scenarios=2).trials) == 20
    with pytest.raises(ConfigurationError, match="seconds = 0: must be > 0"):
        tune(make_problem(), seconds=0)


def test_a_time_too_short_for_any_trial_finishes_the_first_ones_and_says_which_would_do(
    make_problem: MakeProblem,
) -> None:
    tuned = tune(make_problem(), seconds=1e-6)
    assert {trial.candidate.origin for trial in tuned.trials} <= {"paper", "start"}
    assert tuned.best == tuned.problem.experiment
    assert not tuned.verdict.improved
    assert "a short search" in too_short(tuned)
    assert "--time" in too_short(tuned)


def test_bounds_by_gains_that_complete_no_run_are_said_to_have_no_effect(
    make_problem: MakeProblem, tmp_path: Path
) -> None:
    tuned = tune(make_problem(), trials=2, test_scenarios=2)
    (given,) = tuned.training.constraints
    assert not any("without effect" in words for words in tuned.remarks)
    asked = tuned.problem.constraints[0]
    lost = replace(tuned, training=replace(tuned.training, constraints=(asked.given(math.nan),)))
    words = "no reference run completes; without effect: mean.chatter<=1*paper"
    assert words in lost.remarks
    write_study(tmp_path / "study.json", lost, {}, "")
    study = json.loads((tmp_path / "study.json").read_text())
    assert study["constraints"][0]["bound"] is None
    assert given.bound > 0


def test_a_search_without_a_budget_is_not_called_short(make_problem: MakeProblem) -> None:
    wide = tuning_problem(case=4)
    gains = len(wide.space.dimensions)
    assert gains > 10, "the usual thousand trials would be too few"
    assert trials_of(wide, None, None, None) == 100 * gains
    assert short_of(100 * gains - 1, gains, wide.options, None)
    assert not short_of(100 * gains, gains, wide.options, None)
    assert trials_of(make_problem(), None, None, None) == 1000
    assert trials_of(wide, 20, None, None) == 20
    assert trials_of(wide, None, 60.0, None) is trials_of(wide, None, None, 500) is None


def test_every_phase_is_told_and_batches_belong_to_the_search(make_problem: MakeProblem) -> None:
    watch = Recorded()
    tune(make_problem(ensemble=None, case=4), trials=40, watch=watch)
    assert tuple(watch.phases) == PHASES
    assert {phase for phase, _, _ in watch.batches} == {SEARCHING}
    assert {(until, trials) for _, until, trials in watch.batches} == {(None, 40)}


def test_the_certificate_is_told_with_how_far_it_is(make_problem: MakeProblem) -> None:
    steps: dict[str, list[tuple[float, str]]] = {}

    def receive(fraction: float, phase: str = "", status: str = "") -> None:
        steps.setdefault(phase, []).append((fraction, status))

    tune(make_problem(), trials=40, test_scenarios=24, watch=TuningProgress(receive))
    shares = [fraction for fraction, _ in steps[CERTIFYING]]
    assert any(0 < share < 1 for share in shares)
    assert any(status.startswith("certifying: candidate 1 in ") for _, status in steps[CERTIFYING])


def test_a_choice_that_takes_more_rollouts_than_the_search_is_said_to() -> None:
    cost = TuningCost(1000, 1.0, 1.0, 1.0, 1.0, 0.0, judging_rollouts=501)
    assert cost.mostly_judging == "501 of them for choosing and scoring"
    assert replace(cost, judging_rollouts=500).mostly_judging == ""


@pytest.mark.slow
def test_a_time_is_that_of_the_search_and_little_comes_on_top(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Time goes by with rollouts alone, each of which takes 5 ms; the search has 20 s, and nothing is compiled."""
    pace, seconds, time = 0.005, 20.0, [1000.0]
    rollouts = scorer.run_pairs

    def run_pairs(*words: object, **options: object) -> object:
        result = rollouts(*words, **options)  # pyright: ignore[reportArgumentType]
        time[0] += pace * result.outcomes.size
        return result

    monkeypatch.setattr(clock, "now", lambda: time[0])
    monkeypatch.setattr(clock, "build_seconds", lambda: 0.0)
    monkeypatch.setattr(scorer, "run_pairs", run_pairs)
    problem = make_problem(options=TuningOptions())
    tuned = tune(problem, seconds=seconds)
    batch = (
        pace * tuned.training.problem.options.generation * (len(tuned.training.scenarios) + len(tuned.training.hard))
        + pace * 64
    )
    assert seconds <= tuned.cost.searching <= seconds + batch
    assert tuned.cost.searching + tuned.cost.judging <= 36.0
    assert tuned.cost.judging == pytest.approx(pace * tuned.cost.judging_rollouts)
    assert tuned.verdict.certificate is not None
    assert tuned.verdict.certificate.satisfied
    hurried = tune(problem, seconds=seconds, reserved_seconds=12.0)
    assert hurried.verdict.certificate is not None
    assert hurried.verdict.certificate.satisfied, "the search shrinks, not the certificate"
    assert hurried.cost.searching + hurried.cost.judging <= 24.0 + batch


@pytest.mark.parametrize(("trials", "said"), [(4, ""), (50, "30 s of search left · ")])
def test_the_time_left_is_said_once_it_means_something(trials: int, said: str) -> None:
    words: list[str] = []

    def receive(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        words.append(status)

    TuningProgress(receive).progress(SearchStatus(trials=trials, seconds=230.0, compiling=200.0), None, 100)
    assert words == [f"{said}{trials} of 100 trials, 0 of 0 that ran in all scenarios feasible"]


SHORT = "a short search: 480 trials, and 16 gains need about 1600: "


@pytest.mark.parametrize(
    ("trials", "budget", "words"),
    [
        (480, (60.0,), f"{SHORT}--time 4min"),
        (480, (None,), f"{SHORT}--trials 1600"),
        (480, (None, 4100), f"{SHORT}--rollouts 14000"),
        (1600, (60.0,), ""),
    ],
)
def test_a_search_that_is_too_short_for_its_gains_is_said_to_be(trials: int, budget: Any, words: str) -> None:
    assert short_of(trials, 16, TuningOptions(), *budget) == words


def test_an_interrupt_ends_the_search_and_the_best_so_far_is_scored(make_problem: MakeProblem) -> None:
    watch = Recorded(interrupt_at=32)
    tuned = tune(make_problem(), trials=1000, test_scenarios=6, watch=watch)
    assert tuned.interrupted
    assert len(tuned.trials) == tuned.progress.trials >= 32
    assert tuple(watch.phases) == PHASES
    assert tuned.verdict.scored.scenarios == 6


def test_where_nothing_is_better_the_start_is_kept_and_what_would_help_is_said(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(METHODS, "stubborn", Stubborn)
    tuned = tune(make_problem(ensemble=None, case=4, constraints=[]), method="stubborn", trials=20)
    assert tuned.best == tuned.problem.experiment
    assert headline(tuned).startswith(
        "the start is kept: no trial is better than the gains that the search started from"
    )
    words = advice(tuned)
    assert "more trials (--time, --trials, --resume): 300 or more" in words[0]
    assert words[-1] == "another method (--method cmaes)"


def test_a_best_that_breaks_constraints_is_said_to_and_what_would_help(make_problem: MakeProblem) -> None:
    tuned = tune(make_problem(constraints=["mean.chatter<=0.001*paper"]), trials=20, test_scenarios=6)
    assert not tuned.verdict.scored.feasible
    assert "In 6 test scenarios the start violates mean.chatter <= " in worth(tuned)
    assert any(
        "a looser bound (--constraint)" in words and "violate mean.chatter <= " in words for words in advice(tuned)
    )


def test_wider_bounds_are_advised_for_gains_that_the_search_leaves_at_theirs(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(METHODS, "stubborn", Stubborn)
    space = ["controller.nftsm.beta", "controller.kalman.ramp"]
    tuned = tune(make_problem(space=space, constraints=[]), method="stubborn", trials=6, test_scenarios=4)
    assert "wider bounds (--space): the best trials lie at those of nftsm.beta" in advice(tuned)  # a ramp is >= 0


def test_a_gain_at_the_end_of_its_allowed_range_needs_no_wider_bounds(make_problem: MakeProblem) -> None:
    beta, share = "controller.nftsm.beta", "controller.kalman.compensation"
    kept = tune(make_problem(space=[beta, share], constraints=[]), method="random", trials=2, test_scenarios=4)
    best = kept.verdict.best
    candidate = replace(best.candidate, point=best.point | {beta: 0.005, share: 1.0})
    tuned = replace(kept, verdict=replace(kept.verdict, obstacle="", best=replace(best, candidate=candidate)))
    assert gains_at_bounds(tuned) == [(beta, 0.005)]


def test_gains_that_change_nothing_need_no_wider_bounds(
    make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing saturates in these runs, so the anti-saturation system is idle whatever its gains."""
    monkeypatch.setitem(METHODS, "stubborn", Stubborn)
    beta, k_a, gamma = "controller.nftsm.beta", "controller.auxiliary.k_a", "controller.auxiliary.gamma"
    kept = tune(make_problem(space=[beta, k_a, gamma], constraints=[]), method="stubborn", trials=6, test_scenarios=4)
    best, ends = kept.verdict.best, {beta: 0.005, k_a: 100.0, gamma: 1e-3}
    candidate = replace(best.candidate, point=best.point | ends)
    tuned = replace(kept, verdict=replace(kept.verdict, obstacle="", best=replace(best, candidate=candidate)))
    assert tuned.idle == {k_a, gamma}
    assert gains_at_bounds(tuned) == [(beta, 0.005)]
    assert widen(tuned) == f"gains end at a bound of the search (--space); widen: {beta} (0.005)"


def test_there_is_no_advice_where_nothing_is_wrong(tuned: TuningResult) -> None:
    assert advice(tuned) == []
    assert headline(tuned).startswith(
        f"trial {tuned.verdict.best.number} of 96 is the best; scored in 6 test scenarios"
    )
    assert list(headings(tuned)) == ["best", "start", "paper"]
    assert "times lower than the paper's and " in comparison(tuned)


def test_where_scenarios_are_infeasible_the_feasible_ones_are_compared_first(tuned: TuningResult) -> None:
    verdict, count = tuned.verdict, tuned.verdict.scored.scenarios
    best = replace(verdict.scores["best"], evaluation=verdict.scores["start"].evaluation)
    mixed = replace(
        verdict, scores=verdict.scores | {"best": best}, within_authority=np.arange(count) != 2, contradiction=""
    )
    words = comparison(replace(tuned, verdict=mixed))
    assert words == f"{comparison(tuned)} in the {count - 1} test scenarios within the motors' authority"
    words = authority(replace(tuned, verdict=mixed))
    assert words.startswith("1 of the scenarios demands more than 95 %")
    assert words.endswith(" and as large as the start's")


def test_gains_that_lose_runs_or_violate_a_bound_are_not_called_free_of_cost(tuned: TuningResult) -> None:
    verdict = tuned.verdict
    sound = replace(verdict.scored, violations=dict.fromkeys(verdict.scored.violations, 0.0))
    lossy = replace(
        sound, violations=sound.violations | {FAILED: 0.5}, outcomes={"completed": 3, "diverged": 1, "left_track": 2}
    )
    violating = replace(sound, violations=sound.violations | {"worst.min_tension >= 80 N": 0.1})

    def said(scored: Evaluation) -> str:
        ours = replace(scored, statistics=scored.statistics | {"mean.chatter": 0.5 * paper["mean.chatter"]})
        best = replace(verdict.scores["best"], evaluation=ours)
        return " ".join(costs(replace(tuned, verdict=replace(verdict, scores=verdict.scores | {"best": best}))))

    paper = verdict.statistics("paper")
    assert "Chatter: 0.5 × the paper's, no cost." in said(sound)
    for scored, words in (
        (lossy, "3 of 6 runs do not complete; means are over the others."),
        (violating, "These gains violate a bound; a lower cost does not make up for that."),
    ):
        assert said(scored).startswith(words)
        assert "Chatter: 0.5 × the paper's." in said(scored)
        assert "no cost" not in said(scored)


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (956.6, "957 times lower than the paper's"),
        (61042.0, "61 000 times lower than the paper's"),
        (0.7068, "1.41 × the paper's (worse)"),
        (1.0001, "as large as the paper's"),
        (0.9975, "as large as the paper's"),
        (float("inf"), "not comparable with the paper's"),
    ],
)
def test_ratios_in_words_never_call_more_less(ratio: float, words: str) -> None:
    assert times(ratio, "the paper's") == words


def test_every_figure_says_what_it_shows(tuned: TuningResult) -> None:
    problem, trials, verdict = tuned.problem, tuned.trials, tuned.verdict
    shown = distributions(verdict)
    drawn = (
        tuned.plot(),
        importance(problem, trials),
        best_gains(problem, trials, verdict),
        front(problem, tuned.training.constraints, trials),
        before_and_after(problem, verdict),
        shown,
    )
    assert shown
    assert "peak tension (kN)" in {axes.get_xlabel() for axes in shown.axes}
    for figure in drawn:
        assert figure
        assert figure.texts[0].get_text()
        assert all(axes.lines or axes.patches for axes in figure.axes)
    assert sum(importances(problem, trials).values()) == pytest.approx(1)


def test_only_gains_that_hold_are_recommended_for_hardware_and_advice_is_on_others(tuned: TuningResult) -> None:
    """A violation in the test set, which is rarer than the certificate allows, changes neither."""
    scored = tuned.verdict.scored
    rare = replace(scored, violations=scored.violations | {"worst.min_tension >= 80 N": 0.1}, violated=1)
    scores = tuned.verdict.scores | {"best": replace(tuned.verdict.scores["best"], evaluation=rare)}

    def recommended(certificate: SampleCertificate) -> bool:
        verdict = replace(tuned.verdict, certificate=certificate, obstacle="", contradiction="", scores=scores)
        result = replace(tuned, verdict=verdict)
        hardware = any("hardware" in words for words, _ in next_steps(result, Path("tuned")))
        assert hardware == (not advice(result))
        return hardware

    certificate = SampleCertificate(violation=0.005, confidence=0.95, draws=1000, machines=59)
    assert recommended(certificate)
    assert not recommended(replace(certificate, violations=30))
    assert not recommended(replace(certificate, means={"mean.chatter": 0.01}))


def test_the_chosen_gains_are_drawn_and_no_others_are_called_the_best(tuned: TuningResult) -> None:
    def drawn(verdict: SelectionResult) -> dict[str, list[float]]:
        (axes,) = best_gains(tuned.problem, tuned.trials, verdict).axes
        return {str(line.get_label()): list(np.asarray(line.get_xdata())) for line in axes.lines}

    space, verdict = tuned.problem.space, tuned.verdict
    moved = replace(verdict.best.candidate, point=verdict.best.point | {"controller.observer.l0": 7.0})
    chosen = replace(verdict, best=replace(verdict.best, candidate=moved))
    assert drawn(chosen)["best"] == list(space.encoded(moved.point))
    assert drawn(chosen)["start"] == list(space.encoded(tuned.problem.start))
    kept = drawn(replace(verdict, obstacle="no trial is better"))
    assert kept["start, kept"] == list(space.encoded(tuned.problem.start))
    assert not kept.keys() & {"best", "start"}


def test_a_problem_runs_nothing(make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    class RunError(Exception):
        """Something was run."""

    def refuse(*_: object, **__: object) -> object:
        raise RunError

    monkeypatch.setattr("dualwinch.simulation.batch.rollout.ParameterScenarioGrid", refuse)
    problem = make_problem()
    problem.check()
    assert problem.drawn(2, 1) != problem.drawn(2, 1, problem.paper_experiment)
    assert problem.paper_point == problem.start
    assert problem.constraints[0].reference == "paper"
    with pytest.raises(RunError):
        prepare(problem)


def test_a_front_of_two_objectives_has_its_best_by_the_first(make_problem: MakeProblem) -> None:
    tuned = tune(make_problem(objectives=["mean.mse", "mean.chatter"]), trials=48, test_scenarios=6)
    start = tuned.verdict.scores["start"].evaluation
    assert any(ours < theirs for ours, theirs in zip(tuned.verdict.scored.objectives, start.objectives, strict=True))
    assert isinstance(tuned.verdict.best, Evaluation)
