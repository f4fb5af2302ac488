"""Scenarios of the choice: each round has its own, and the search has seen none of them."""

from collections.abc import Sequence

import pytest

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.config import SampleSizes
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.scoring.validation import further_draws, validation_sets
from tests.tuning.conftest import MakeProblem

PLAN = SampleSizes(draws=5, vertices=3, hard=2, looked_at=20, last_draws=7, confirmed=9)


def seeds(scenarios: Sequence[object]) -> set[int]:
    """What tells draws apart, on whatever machine: the seed of what acts on the vehicle."""
    return {int(each.experiment.simulation.seed) for each in scenarios if isinstance(each, Scenario)}


def test_no_draw_is_in_two_rounds_and_the_search_has_seen_none(make_problem: MakeProblem) -> None:
    problem = make_problem(ensemble="rig")
    first, last, _ = validation_sets(problem, PLAN)
    further, prepared = further_draws(problem, PLAN), prepare(problem)
    assert len(further) == PLAN.confirmed
    assert len(first) <= PLAN.draws + PLAN.hard + PLAN.vertices
    assert len(last) <= PLAN.last_draws
    rounds = [seeds(each) for each in (first, last, further, (*prepared.scenarios, *prepared.stress))]
    assert sum(map(len, rounds)) == len(set().union(*rounds))
    assert [len(seeds([each])) for each in further] == [1] * len(further)


def test_without_an_ensemble_there_is_nothing_to_choose_in(make_problem: MakeProblem) -> None:
    problem = make_problem(ensemble=None)
    assert further_draws(problem, PLAN) == []
    with pytest.raises(ValueError, match="ensemble"):
        validation_sets(problem, PLAN)
