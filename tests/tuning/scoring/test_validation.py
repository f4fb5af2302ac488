"""Validation set: candidates are out at the first violation, hardest scenarios first; feasible ones are run in all."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import VALIDATION, TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.scoring.validation import ValidationSet
from dualwinch.tuning.selection_config import SelectionConfig
from tests.studies import MakeProblem

PRELOAD = "controller.coordination.preload"
SHARES = (0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.3, 1.4)


def others(problem: TuningProblem) -> list[Scenario]:
    """Scenarios that nothing was tuned in."""
    assert problem.ensemble
    return list(replace(problem.ensemble, experiment=problem.experiment).scenarios(30, problem.stream(VALIDATION)))


def trials(evaluator: Evaluator) -> list[Evaluation]:
    """Trials that differ in preload: the more, the higher the peaks."""
    start = evaluator.training.problem.start
    points = [start | {PRELOAD: share * float(start[PRELOAD])} for share in SHARES]
    return [
        replace(each, number=number)
        for number, each in enumerate(evaluator.evaluate([Candidate(point, "x") for point in points]))
    ]


@pytest.fixture
def evaluator(make_problem: MakeProblem) -> Evaluator:
    """Of a problem whose peaks are bounded where half of the trials exceed the bound in some scenario."""
    free = Evaluator(prepare(make_problem()), prune=False)
    peaks = [
        each.statistics["worst.peak_tension"]
        for each in free.over([trial.candidate for trial in trials(free)], others(free.training.problem))
    ]
    bound = sum(sorted(peaks)[3:5]) / 2
    return Evaluator(prepare(make_problem(constraints=[f"worst.peak_tension<={bound}"])), prune=False)


def test_who_holds_comes_to_what_it_comes_to_in_all_scenarios_and_who_does_not_is_dropped(evaluator: Evaluator) -> None:
    given, scenarios = trials(evaluator), others(evaluator.training.problem)
    whole = evaluator.over([trial.candidate for trial in given], scenarios)
    attempts = ValidationSet(evaluator, scenarios).screen([trial.candidate for trial in given])
    held = [attempt.result is not None and attempt.result.feasible for attempt in attempts]
    assert held == [each.feasible for each in whole]
    assert 0 < sum(held) < len(given)
    (label,) = (constraint.label for constraint in evaluator.training.constraints)
    for attempt, every in zip(attempts, whole, strict=True):
        assert (attempt.excess <= 0) == every.feasible
        assert attempt.excess <= every.violations[label] + 1e-12
        if attempt.result is not None:
            assert attempt.result.scenarios == len(scenarios)
            assert attempt.result.statistics == pytest.approx(every.statistics, rel=1e-12)
            assert attempt.excess == pytest.approx(every.violations[label], rel=1e-9)


def test_trials_meet_first_where_most_have_failed(evaluator: Evaluator) -> None:
    given, scenarios = [trial.candidate for trial in trials(evaluator)], others(evaluator.training.problem)
    screen = ValidationSet(evaluator, scenarios)
    failing = [one for one, attempt in zip(given, screen.screen(given), strict=True) if attempt.excess > 0]
    assert failing
    before = evaluator.rollouts
    assert [attempt.result for attempt in screen.screen(failing)] == [None] * len(failing)
    assert evaluator.rollouts - before == SelectionConfig.first_screened * len(failing)


@pytest.mark.slow
def test_stability_margins_are_looked_at_only_where_all_else_holds(make_problem: MakeProblem) -> None:
    free = Evaluator(prepare(make_problem()), prune=False)
    scenarios = others(free.training.problem)
    peaks = free.run([trials(free)[SHARES.index(1.0)].candidate], scenarios).metrics["peak_tension"][0]
    bound = np.sort(peaks)[-2:].mean()
    problem = make_problem(constraints=[f"worst.peak_tension<={bound}", "worst.delay_margin>=1ms"])
    bounded = Evaluator(prepare(problem), prune=False)
    hardest_last = [scenarios[index] for index in np.argsort(peaks)]
    met = ValidationSet(bounded, hardest_last).screen([trial.candidate for trial in trials(bounded)])
    held, exceeding = met[0].result, met[SHARES.index(1.0)].result
    assert held is not None
    assert exceeding is not None
    assert (held.feasible, exceeding.feasible) == (True, False)
    assert "worst.delay_margin" in held.statistics
    assert "worst.delay_margin" not in exceeding.statistics


def test_nobody_meets_nowhere(evaluator: Evaluator) -> None:
    assert ValidationSet(evaluator, others(evaluator.training.problem)).screen([]) == []
