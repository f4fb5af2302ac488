"""The best once more in draws that nobody saw: it gets more reserve where its peaks come near, never less."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.repair import repaired_after_further_draws
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.selection_config import SelectionConfig
from tests.tuning.conftest import MakeProblem

DISTANCE = SelectionConfig.repair_back_off
SPACE = [f"{RESERVE}=0:225"]


def bounded(make_problem: MakeProblem, *bounds: str, space: list[str] = SPACE) -> Evaluator:
    return Evaluator(prepare(make_problem(ensemble="rig", space=space, constraints=list(bounds))))


def trial(evaluator: Evaluator, reserve: float) -> Evaluation:
    (found,) = evaluator.over([Candidate({RESERVE: reserve}, "x")], evaluator.for_the_best, training=True)
    return replace(found, number=4)


def draws(evaluator: Evaluator) -> list[Scenario]:
    """Scenarios with the highest peaks that a bound may be about, those in which it was tuned."""
    scenarios = (each for each in evaluator.for_the_best if isinstance(each, Scenario))
    return [scenario for scenario in scenarios if not scenario.beyond_authority]


def highest(evaluator: Evaluator, reserve: float) -> float:
    result = evaluator.run([Candidate({RESERVE: reserve}, "x")], draws(evaluator))
    return float(result.metrics["peak_tension"].max())


@pytest.fixture
def peak(make_problem: MakeProblem) -> float:
    """The highest tension there with a reserve of 20 N."""
    return highest(bounded(make_problem, "worst.peak_tension<=6000"), 20.0)


def test_peaks_that_come_too_near_to_the_bound_get_more_reserve(make_problem: MakeProblem, peak: float) -> None:
    bound = peak / (1 - DISTANCE / 4)
    evaluator = bounded(make_problem, f"worst.peak_tension<={bound}")
    was = trial(evaluator, 20.0)
    found = repaired_after_further_draws(evaluator, was, draws(evaluator))
    assert found.number == was.number
    assert found.point[RESERVE] == pytest.approx(20.0 + 0.75 * DISTANCE * bound)
    assert found.scenarios == was.scenarios, "it has met in all in which the best are tuned"


def test_it_gets_as_much_more_reserve_as_keeps_to_all_bounds_where_tuned(
    make_problem: MakeProblem, peak: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    bound = peak / (1 - DISTANCE / 4)
    evaluator = bounded(make_problem, f"worst.peak_tension<={bound}")
    was, over, wanted = trial(evaluator, 20.0), evaluator.over, 0.75 * DISTANCE * bound

    def broken_beyond(candidates: Sequence[Candidate], *scenarios: Any, **options: Any) -> list[Evaluation]:
        found = over(candidates, *scenarios, **options)
        much = [float(each.point[RESERVE]) > 20.0 + 0.6 * wanted for each in found]
        return [replace(each, violations={"x": 1.0}) if more else each for each, more in zip(found, much, strict=True)]

    monkeypatch.setattr(evaluator, "over", broken_beyond)
    assert repaired_after_further_draws(evaluator, was, draws(evaluator)).point[RESERVE] == pytest.approx(
        20.0 + 0.5 * wanted
    )


@pytest.mark.parametrize("room", [1.1 * DISTANCE, 0.05, -0.05])
def test_with_room_or_where_it_is_far_too_high_the_reserve_stays(
    room: float, make_problem: MakeProblem, peak: float
) -> None:
    evaluator = bounded(make_problem, f"worst.peak_tension<={peak / (1 - room)}")
    was = trial(evaluator, 20.0)
    assert repaired_after_further_draws(evaluator, was, draws(evaluator)) is was


def test_who_breaks_a_bound_where_tuned_with_more_reserve_stays_as_it_was(
    make_problem: MakeProblem, peak: float
) -> None:
    bounds = [f"worst.peak_tension<={peak / (1 - DISTANCE / 4)}", "worst.mse<=1e-30"]
    evaluator = bounded(make_problem, *bounds)
    was = trial(evaluator, 20.0)
    assert repaired_after_further_draws(evaluator, was, draws(evaluator)) is was


def test_nothing_is_run_where_nothing_could_be_raised(make_problem: MakeProblem) -> None:
    others = ["controller.coordination.preload"]
    without = [bounded(make_problem), bounded(make_problem, "worst.peak_tension<=6000", space=others)]
    for evaluator in without:
        was, before = evaluator.start(), evaluator.rollouts
        assert repaired_after_further_draws(evaluator, was, draws(evaluator)) is was
        assert evaluator.rollouts == before
    evaluator = bounded(make_problem, "worst.peak_tension<=6000")
    was = evaluator.start()
    assert repaired_after_further_draws(evaluator, was, []) is was
