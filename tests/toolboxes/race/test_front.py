"""Fronts: what no other trial dominates, spread evenly."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.toolboxes.race.scores import front
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, undominated

points = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=30)


@given(points)
def test_what_is_kept_is_what_nobody_beats(given_points: list[tuple[int, int]]) -> None:
    pairs = np.array(given_points, float).reshape(-1, 2)
    kept = undominated(pairs[:, 0], pairs[:, 1])
    dominated = {
        index
        for index, (cost, error) in enumerate(given_points)
        if any(c <= cost and e <= error and (c, e) != (cost, error) for c, e in given_points)
    }
    assert {given_points[index] for index in kept} == {
        pair for index, pair in enumerate(given_points) if index not in dominated
    }
    assert [given_points[index][0] for index in kept] == sorted({given_points[index][0] for index in kept})


def trial(cost: float, error: float, violation: float = -1.0) -> Evaluation:
    statistics = {"mean.chatter": cost, "mean.mse": error}
    return Evaluation(Candidate({}, "x"), (error,), {"bound": violation}, statistics, {}, 8)


def test_a_front_has_both_ends_and_no_trial_that_breaks_a_constraint() -> None:
    whole = [trial(float(cost), 100.0 - cost) for cost in range(20)]
    found = front([*whole, trial(-1, -1, violation=0.1), replace(trial(-2, -2), pruned=True)], "chatter", 5)
    assert [each.statistics["mean.chatter"] for each in found] == [0, 5, 10, 14, 19]
    assert front(whole[:3], "chatter") == whole[:3]
    assert front([trial(1, 1, violation=1)], "chatter") == []
