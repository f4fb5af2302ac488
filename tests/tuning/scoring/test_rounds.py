"""Scenarios of the choice: each round has its own, and the search has seen none of them."""

from collections.abc import Sequence

import pytest

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import SEARCH, TEST, TRAINING, VALIDATION
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.scoring.validation import further_draws, validation_sets
from dualwinch.tuning.selection_config import SampleSizes
from tests.tuning.conftest import MakeProblem

SIZES = SampleSizes(draws=5, vertices=3, hard_draws=2, hard_among=20, second_draws=7, further_draws=9)


def seeds(scenarios: Sequence[object]) -> set[int]:
    """What tells draws apart, on whatever machine: the seed of what acts on the vehicle."""
    return {int(each.experiment.simulation.seed) for each in scenarios if isinstance(each, Scenario)}


def test_no_draw_is_in_two_rounds_and_the_search_has_seen_none(make_problem: MakeProblem) -> None:
    problem = make_problem(ensemble="rig")
    first, last, _ = validation_sets(problem, SIZES)
    further, prepared = further_draws(problem, SIZES), prepare(problem)
    assert len(further) == SIZES.further_draws
    assert len(first) <= SIZES.draws + SIZES.hard_draws + SIZES.vertices
    assert len(last) <= SIZES.second_draws
    rounds = [seeds(each) for each in (first, last, further, (*prepared.scenarios, *prepared.hard))]
    assert sum(map(len, rounds)) == len(set().union(*rounds))
    assert [len(seeds([each])) for each in further] == [1] * len(further)


def test_without_an_ensemble_there_is_nothing_to_choose_in(make_problem: MakeProblem) -> None:
    problem = make_problem(ensemble=None)
    assert further_draws(problem, SIZES) == []
    with pytest.raises(ValueError, match="ensemble"):
        validation_sets(problem, SIZES)


def test_no_seed_makes_one_set_that_of_another(make_problem: MakeProblem) -> None:
    """Were seeds made by addition, a study of seed 1 000 000 would search in what seed 0 chooses in."""
    problems = [make_problem(seed=seed) for seed in (0, 1, 1_000_000, 2_000_000)]
    streams = [problem.stream(name) for problem in problems for name in (TRAINING, VALIDATION, TEST, SEARCH)]
    assert len(set(streams)) == len(streams)
    sets = [seeds(problem.drawn(3, problem.stream(name))) for problem in problems for name in (VALIDATION, TEST)]
    sets += [seeds(prepare(problem).scenarios) for problem in problems]
    assert sum(map(len, sets)) == len(set().union(*sets))
