"""Which scenarios are tuned and chosen in: draws as they come, and corners that the motors can hardly hold."""

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.analysis.required_force import shortfall
from dualwinch.tuning.scoring.scenarios import FURTHEST, PROMISED, corners, pick, promised

SEA = load_ensemble("sea")


def test_draws_and_corners_are_spread_and_the_hardest_corners_are_not_too_hard() -> None:
    picks, more = pick(SEA, 8, 2, 3)
    assert [one.corner for one in picks] == [True, False, True, True, True, False, True, True]
    assert [one.index for one in picks if not one.corner] == [0, 1]
    drawn = [one.drawn(SEA, 3) for one in picks]
    assert [one.extreme for one in drawn] == [one.corner for one in picks]
    assert drawn[1].draws == SEA.scenario(0, 3).draws
    behind = [shortfall(one.experiment) for one in drawn if one.extreme]
    assert behind[0] > behind[2] > behind[4] > 0.003  # every other one is hard
    assert max(behind) <= FURTHEST
    assert all(one.corner and one not in picks for one in more)
    assert pick(SEA, 8, 2, 3) == (picks, more)


def test_one_scenario_is_a_plain_draw() -> None:
    assert [one.corner for one in pick(SEA, 1, 0, 3)[0]] == [False]


def test_gains_are_chosen_in_all_but_the_very_hardest_scenarios() -> None:
    hard = [one.drawn(SEA, 0) for one in corners(SEA, 8, 0)]  # some of this seed's are harder than promised
    kept = promised(hard)
    assert [one for one in hard if shortfall(one.experiment) <= PROMISED] == kept
    assert 0 < len(kept) < len(hard)
    assert all(shortfall(one.drawn(SEA, 0).experiment) <= PROMISED for one in corners(SEA, 8, 0, PROMISED))
