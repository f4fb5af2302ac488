"""The training set: random draws for means, and those that demand the most force as first cuts."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.authority import force_demands
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.problem import CERTIFICATE, CHECKS, SEARCH, TEST, TRAINING
from dualwinch.tuning.scoring.training_set import (
    LARGEST_LAG,
    beyond_authority_as_hard,
    prepare,
    training_scenarios,
    with_authority,
)
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.studies import MakeProblem

OPTIONS = TuningOptions(draws=8, hard=5, population=80)
PROBLEM = tuning_problem(ensemble="sea", seed=3, options=OPTIONS)


def test_random_draws_come_first_and_the_hard_ones_demand_the_most_force_that_is_not_too_much() -> None:
    random, hard = training_scenarios(PROBLEM)
    draws = PROBLEM.drawn_ensemble.chosen(range(OPTIONS.population), PROBLEM.stream(TRAINING))
    demands = force_demands(draws)
    assert [each.index for each in random] == list(range(OPTIONS.draws))
    assert [each.hard for each in random] == [demand.share >= OPTIONS.authority for demand in demands[: OPTIONS.draws]]
    shares = [demands[each.index].share for each in hard]
    assert all(each.hard and demands[each.index].shortfall <= LARGEST_LAG for each in hard)
    assert all(before >= after for before, after in pairwise(shares))
    harder = [demand for demand in demands[OPTIONS.draws :] if demand.share > shares[0]]
    assert all(demand.shortfall > LARGEST_LAG for demand in harder)
    assert len(hard) == OPTIONS.hard


def test_draws_beyond_the_motors_authority_count_in_worst_cases_only_unless_all_are() -> None:
    draws = PROBLEM.drawn_ensemble.chosen(range(60), 7)
    within = with_authority(force_demands(draws), 0.95)
    assert 0 < within.sum() < len(draws)
    assert [each.hard for each in beyond_authority_as_hard(draws, within)] == (~within).tolist()
    assert beyond_authority_as_hard(draws, np.zeros(len(draws), bool)) == draws


def seeds(scenarios: Sequence[object]) -> set[object]:
    """The seed of what acts on the vehicle tells draws apart."""
    return {each.draws["simulation.seed"] for each in scenarios if isinstance(each, Scenario)}


def test_no_draw_is_in_two_sets_whatever_the_seed(make_problem: MakeProblem) -> None:
    problems = [make_problem(seed=seed) for seed in (0, 1, 1_000_000)]
    names = (TRAINING, CHECKS, CERTIFICATE, TEST, SEARCH)
    streams = [problem.stream(name) for problem in problems for name in names]
    assert len(set(streams)) == len(streams)
    sets = [seeds(problem.drawn(9, problem.stream(name))) for problem in problems for name in names[1:4]]
    prepared = prepare(problems[0])
    sets.append(seeds((*prepared.scenarios, *prepared.hard)))
    assert sum(map(len, sets)) == len(set().union(*sets))


def test_probabilities_lie_between_0_and_1() -> None:
    for words in ({"violation": 0.0}, {"violation": 1.0}, {"confidence": 95.0}):
        with pytest.raises(ConfigurationError, match="must be > 0 and < 1"):
            replace(OPTIONS, **words)
