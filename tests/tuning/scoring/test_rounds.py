"""Scenarios of validation, chance constraint and test: each has its own, and the search has seen none of them."""

from collections.abc import Sequence

import pytest

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import CHANCE, SEARCH, TEST, TRAINING, VALIDATION
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.scoring.validation import validation_scenarios
from dualwinch.tuning.selection_config import SampleSizes
from tests.studies import MakeProblem

SIZES = SampleSizes(draws=5, vertices=3)


def seeds(scenarios: Sequence[object]) -> set[int]:
    """What tells draws apart, on whatever machine: the seed of what acts on the vehicle."""
    return {int(each.experiment.simulation.seed) for each in scenarios if isinstance(each, Scenario)}


def test_no_draw_is_in_two_sets_and_the_search_has_seen_none(make_problem: MakeProblem) -> None:
    problem = make_problem()
    validation, prepared = validation_scenarios(problem, SIZES), prepare(problem)
    assert len(validation) <= SIZES.draws + SIZES.vertices
    assert sum(each.vertex for each in validation) == SIZES.vertices
    sets = [seeds(validation), seeds((*prepared.scenarios, *prepared.hard))]
    sets += [seeds(problem.drawn(9, problem.stream(name))) for name in (CHANCE, TEST)]
    assert sum(map(len, sets)) == len(set().union(*sets))


def test_without_an_ensemble_there_is_no_validation_set(make_problem: MakeProblem) -> None:
    with pytest.raises(ValueError, match="ensemble"):
        validation_scenarios(make_problem(ensemble=None), SIZES)


def test_no_seed_makes_one_set_that_of_another(make_problem: MakeProblem) -> None:
    """Were seeds made by addition, a study of seed 1 000 000 would search in what seed 0 chooses in."""
    problems = [make_problem(seed=seed) for seed in (0, 1, 1_000_000, 2_000_000)]
    streams = [problem.stream(name) for problem in problems for name in (TRAINING, VALIDATION, CHANCE, TEST, SEARCH)]
    assert len(set(streams)) == len(streams)
    sets = [
        seeds(problem.drawn(3, problem.stream(name))) for problem in problems for name in (VALIDATION, CHANCE, TEST)
    ]
    sets += [seeds(prepare(problem).scenarios) for problem in problems]
    assert sum(map(len, sets)) == len(set().union(*sets))
