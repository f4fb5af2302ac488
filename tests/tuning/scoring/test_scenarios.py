"""Which scenarios are tuned and chosen in: typical ones for the means, hard ones for what is the worst."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.batch.authority import ForceDemand, force_demands, required_force, within_authority
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring import training_set
from dualwinch.tuning.scoring.training_set import training_scenarios, validation_draws, vertices
from dualwinch.tuning.selection_config import SelectionConfig

RIG, SEA = load_ensemble("rig"), load_ensemble("sea")
CONFIG = SelectionConfig(demand_among=80)
FURTHEST, LOOKED_AT = CONFIG.largest_lag, CONFIG.demand_among


@pytest.fixture(scope="module", autouse=True)
def demands_once() -> Iterator[None]:
    """The same draws are asked for again and again: what each of them demands is computed once."""
    known: dict[str, ForceDemand] = {}

    def demands(scenarios: Sequence[Scenario]) -> list[ForceDemand]:
        unknown = [each for each in scenarios if repr(each) not in known]
        known.update(zip(map(repr, unknown), force_demands(unknown), strict=True))
        return [known[repr(each)] for each in scenarios]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_set, "force_demands", demands)
        yield


def having(hard_training: int) -> SelectionConfig:
    return replace(CONFIG, hard_training=hard_training)


def share(scenario: Scenario) -> float:
    experiment = scenario.experiment
    return float(np.abs(required_force(experiment)).max()) / experiment.controller.limits.strength


def test_typical_and_hard_scenarios_take_turns() -> None:
    picks, more = training_scenarios(SEA, 12, 3, having(3))
    assert all(picked.index < LOOKED_AT for picked in (*picks, *more))
    assert [picked.hard for picked in picks] == [False, True] * 6
    assert [picked.vertex for picked in picks if picked.hard] == [False, True] * 3
    assert len(more) == 3
    assert all(picked.hard and picked not in picks for picked in more)
    assert training_scenarios(SEA, 12, 3, having(3)) == (picks, more)
    for picked in (*picks, *more):
        plain = SEA.scenario(picked.index, 3, vertex=picked.vertex)
        assert picked == replace(plain, base=picked.base, hard=picked.hard)
        assert picked.experiment == plain.experiment


def test_two_of_three_typical_draws_are_on_machines_without_errors() -> None:
    picks, more = training_scenarios(RIG, 12, 3, having(3))

    def exact(scenario: Scenario) -> bool:
        return scenario.experiment.plant.winch_1.radius_error == 0

    assert [exact(picked) for picked in picks if not picked.hard] == [False, True, True] * 2
    assert not any(exact(picked) for picked in picks if picked.hard)
    assert not any(exact(picked) for picked in more)


def test_typical_draws_are_those_in_the_middle_of_equal_shares_of_all() -> None:
    every = sorted(share(scenario) for scenario in SEA.scenarios(LOOKED_AT, 3))
    picks, _ = training_scenarios(SEA, 8, 3, having(0))
    typical = [share(scenario) for scenario in picks if not scenario.hard]
    assert np.allclose(typical, [every[int((number + 0.5) / 4 * len(every))] for number in range(4)], rtol=1e-12)


def test_hard_draws_ask_for_the_most_force_that_is_not_too_much() -> None:
    picks, more = training_scenarios(SEA, 8, 3, having(12))
    hard = [each for each in (*picks, *more) if each.hard and not each.vertex]
    assert all(before > after for before, after in pairwise(map(share, hard)))
    assert all(demand.shortfall <= FURTHEST for demand in force_demands(hard))
    harder = [each for each in SEA.scenarios(LOOKED_AT, 3) if share(each) > share(hard[0])]
    assert all(demand.shortfall > FURTHEST for demand in force_demands(harder))


def test_the_motors_can_hold_vertices() -> None:
    found = vertices(SEA, 12, 0)
    assert all(scenario.vertex and scenario.hard for scenario in found)
    assert within_authority(found).all()
    assert len({scenario.index for scenario in found}) == 12


def test_vertices_differ_by_a_standard_deviation_of_every_value() -> None:
    found = RIG.chosen(range(200), 3, vertex=True)
    masses = np.array([scenario.draws["plant.vehicle.mass"] for scenario in found], float)
    draws = np.array([scenario.draws["plant.vehicle.mass"] for scenario in RIG.chosen(range(2000), 3)], float)
    assert len(np.unique(masses.round(9))) == 2
    assert np.ptp(masses) / 2 == pytest.approx(draws.std(), rel=0.03)
    assert masses.min() + np.ptp(masses) / 2 == pytest.approx(draws.mean(), rel=0.01)


def test_further_hard_scenarios_are_draws_and_a_few_vertices_in_turns() -> None:
    _, more = training_scenarios(SEA, 12, 3, having(48))
    assert len({(each.index, each.vertex) for each in more}) == len(more) == 48
    assert [each.vertex for each in more[:4]] == [False, True, False, True]
    assert sum(each.vertex for each in more) == 8


def test_few_scenarios_are_some_of_each() -> None:
    assert [each.hard for each in training_scenarios(SEA, 1, 3, having(0))[0]] == [False]
    assert [each.hard for each in training_scenarios(SEA, 2, 3, having(0))[0]] == [False, True]
    assert [each.hard for each in training_scenarios(SEA, 3, 3, having(0))[0]] == [False, True, False]


def test_gains_are_chosen_in_all_but_the_very_hardest_scenarios() -> None:
    scenarios = list(SEA.scenarios(100, 7))
    kept = validation_draws(scenarios, CONFIG)
    assert [each.index for each in kept] == [
        each.index
        for each, demand in zip(scenarios, force_demands(scenarios), strict=True)
        if demand.shortfall <= FURTHEST
    ]
    assert 0 < len(kept) < len(scenarios)
    assert [each.hard for each in kept] == (~within_authority(kept)).tolist()
    assert any(each.hard for each in kept)


def test_where_the_motors_can_hold_nothing_all_scenarios_stay_as_they_are() -> None:
    scenarios = list(SEA.scenarios(60, 7))
    beyond = [each for each, within in zip(scenarios, within_authority(scenarios), strict=True) if not within]
    assert validation_draws(beyond, CONFIG) == beyond
