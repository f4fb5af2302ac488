"""Which scenarios are tuned and chosen in: draws as they come, and vertices that the motors can hardly hold."""

from dataclasses import replace

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.settings import override
from dualwinch.simulation.analysis.required_force import demand, shortfall
from dualwinch.tuning.scoring.scenarios import (
    CHOSEN_SHORTFALL,
    FEASIBLE_DEMAND,
    TUNED_SHORTFALL,
    choosable,
    drawn,
    feasible,
    pick,
    vertices,
)

SEA = load_ensemble("sea")


def test_draws_and_vertices_are_spread_and_the_hardest_vertices_are_not_too_hard() -> None:
    picks = pick(SEA, 8, 3)
    assert [picked.vertex for picked in picks] == [True, False, True, True, True, False, True, True]
    assert [picked.index for picked in picks if not picked.vertex] == [1, 2]  # draw 0 takes nearly all the force
    scenarios = drawn(picks, SEA, 3)
    assert [scenario.vertex for scenario in scenarios] == [picked.vertex for picked in picks]
    assert scenarios[1].draws == SEA.scenario(1, 3).draws
    behind = [shortfall(scenario.experiment) for scenario in scenarios if scenario.vertex]
    assert behind[0] > behind[2] > behind[4] > 0.003  # every other one is hard
    assert max(behind) <= TUNED_SHORTFALL
    assert pick(SEA, 8, 3) == picks


def test_one_scenario_is_a_plain_draw() -> None:
    assert [picked.vertex for picked in pick(SEA, 1, 3)] == [False]


def test_draws_leave_force_to_control_with() -> None:
    draws = list(SEA.scenarios(40, 6))
    asked = [demand(scenario.experiment) for scenario in draws]
    taken = [index for index, share in enumerate(asked) if share <= FEASIBLE_DEMAND]
    assert choosable(draws) == [draws[index] for index in taken]
    assert {15, 24} <= set(range(40)) - set(taken)  # where it falls behind
    assert len(taken) > 30
    assert [picked.index for picked in feasible(SEA, 20, 6)] == taken[:20]


def test_where_no_draw_leaves_force_the_nearest_are_taken() -> None:
    weak = replace(SEA, experiment=override(SEA.experiment, {"controller.coordination.tension_max": 3000}))
    draws = list(weak.scenarios(8, 2))
    asked = [demand(scenario.experiment) for scenario in draws]
    assert min(asked) > FEASIBLE_DEMAND
    assert choosable(draws) == draws
    nearest = sorted(range(8), key=lambda index: asked[index])[:2]
    assert [picked.index for picked in feasible(weak, 2, 2)] == sorted(nearest)


def test_vertices_to_choose_in_are_not_too_hard() -> None:
    chosen = drawn(vertices(SEA, 8, 0, furthest=CHOSEN_SHORTFALL), SEA, 0)
    assert all(shortfall(scenario.experiment) <= CHOSEN_SHORTFALL for scenario in chosen)
    assert len({picked.index for picked in vertices(SEA, 8, 3, looked_at=4)}) == 8  # no fewer than are needed
