"""Which scenarios are tuned and chosen in: draws as they come, and vertices that the motors can hardly hold."""

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.analysis.required_force import shortfall
from dualwinch.tuning.scoring.scenarios import CHOSEN_SHORTFALL, TUNED_SHORTFALL, choosable, drawn, pick, vertices

SEA = load_ensemble("sea")


def test_draws_and_vertices_are_spread_and_the_hardest_vertices_are_not_too_hard() -> None:
    picks, more = pick(SEA, 8, 2, 3)
    assert [picked.vertex for picked in picks] == [True, False, True, True, True, False, True, True]
    assert [picked.index for picked in picks if not picked.vertex] == [0, 1]
    scenarios = drawn(picks, SEA, 3)
    assert [scenario.vertex for scenario in scenarios] == [picked.vertex for picked in picks]
    assert scenarios[1].draws == SEA.scenario(0, 3).draws
    behind = [shortfall(scenario.experiment) for scenario in scenarios if scenario.vertex]
    assert behind[0] > behind[2] > behind[4] > 0.003  # every other one is hard
    assert max(behind) <= TUNED_SHORTFALL
    assert all(picked.vertex and picked not in picks for picked in more)
    assert pick(SEA, 8, 2, 3) == (picks, more)


def test_one_scenario_is_a_plain_draw() -> None:
    assert [picked.vertex for picked in pick(SEA, 1, 0, 3)[0]] == [False]


def test_gains_are_chosen_in_all_but_the_very_hardest_scenarios() -> None:
    hard = drawn(vertices(SEA, 8, 0), SEA, 0)
    kept = choosable(hard)
    assert [scenario for scenario in hard if shortfall(scenario.experiment) <= CHOSEN_SHORTFALL] == kept
    assert 0 < len(kept) < len(hard)
    chosen = drawn(vertices(SEA, 8, 0, furthest=CHOSEN_SHORTFALL), SEA, 0)
    assert all(shortfall(scenario.experiment) <= CHOSEN_SHORTFALL for scenario in chosen)
    assert len({picked.index for picked in vertices(SEA, 8, 3, looked_at=4)}) == 8  # no fewer than are needed
