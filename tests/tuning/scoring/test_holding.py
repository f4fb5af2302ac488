"""Who holds: as it is, or with the reserve that it takes, and then where the best are tuned as well."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.repair import screened
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.scoring.validation import FeasibilityScreen, ScreenResult
from dualwinch.tuning.selection_config import SelectionConfig
from tests.tuning.conftest import MakeProblem

MARGIN, DISTANCE = SelectionConfig.back_off, SelectionConfig.selection_back_off
BOUND, HIGHEST = 6000.0, 6100.0
LABEL = "worst.peak_tension <= 6000 N"


class MadeUp(FeasibilityScreen):
    """A validation set in which the highest peak is what the reserve leaves of a force."""

    def __init__(self, evaluator: Evaluator) -> None:
        self.constraints = evaluator.training.constraints

    def screen(self, candidates: Sequence[Candidate]) -> list[ScreenResult]:
        attempts = []
        for candidate in candidates:
            excess = (HIGHEST - float(candidate.point[RESERVE])) / BOUND - 1
            result = Evaluation(candidate, (1.0,), {LABEL: excess}, {}, {}, 1)
            attempts.append(ScreenResult(result if excess <= 0 else None, excess))
        return attempts


@pytest.fixture
def evaluator(make_problem: MakeProblem) -> Evaluator:
    bounds = [f"worst.peak_tension<={BOUND:g}"]
    return Evaluator(prepare(make_problem(ensemble="rig", space=[f"{RESERVE}=0:225"], constraints=bounds)))


def trial(reserve: float, number: int, violation: float = -0.2) -> Evaluation:
    return Evaluation(Candidate({RESERVE: reserve}, "x"), (1.0,), {LABEL: violation}, {}, {}, 1, number=number)


def reserves(evaluator: Evaluator, *trials: Evaluation) -> list[tuple[int, float]]:
    met = screened(evaluator, MadeUp(evaluator), trials, DISTANCE)
    assert all(tuned.point == result.point for tuned, result in met)
    assert all(result.feasible for _, result in met)
    return [(tuned.number, round(float(tuned.point[RESERVE]), 6)) for tuned, _ in met]


def test_who_fails_by_a_little_holds_once_it_has_more_reserve_and_who_has_too_much_gets_less(
    evaluator: Evaluator,
) -> None:
    just = HIGHEST - BOUND * (1 - DISTANCE)
    assert just == pytest.approx(115)
    assert reserves(evaluator, trial(80, 4)) == [(4, 115)]
    assert reserves(evaluator, trial(180, 7)) == [(7, 180), (7, 115)]
    assert reserves(evaluator, trial(115, 9)) == [(9, 115)]


def test_trimmed_ones_are_evaluated_where_the_best_are_tuned(evaluator: Evaluator) -> None:
    ((tuned, _),) = screened(evaluator, MadeUp(evaluator), [trial(80, 4)], DISTANCE)
    assert tuned.scenarios == len(evaluator.for_the_best)
    assert tuned.objectives != (1.0,)


def test_who_comes_near_its_bounds_where_it_was_tuned_keeps_its_reserve(evaluator: Evaluator) -> None:
    assert reserves(evaluator, trial(180, 7, violation=MARGIN - DISTANCE)) == [(7, 180)]
    assert reserves(evaluator, trial(180, 7, violation=MARGIN - DISTANCE - 0.005)) == [(7, 180), (7, 150)]


def test_who_breaks_a_bound_where_it_was_tuned_once_it_is_trimmed_does_not_hold(
    evaluator: Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    over = evaluator.over

    def broken(*given: Any, **words: Any) -> list[Evaluation]:
        return [replace(each, violations={LABEL: 1.1 * MARGIN}) for each in over(*given, **words)]

    monkeypatch.setattr(evaluator, "over", broken)
    assert reserves(evaluator, trial(80, 4), trial(180, 7)) == [(7, 180)]
