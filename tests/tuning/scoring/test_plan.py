"""How much is made of choice and score: all of it without hurry, less beside a short search, never nothing."""

from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.tuning.scoring.config import (
    BESIDE_SECONDS,
    BESIDE_SHARE,
    FULL,
    LEAST,
    LEFT_SECONDS,
    LEFT_SHARE,
    SampleSizes,
    affordable,
    time_for,
)


@given(st.floats(0, 1e3), st.floats(1e-6, 1))
def test_what_is_affordable_takes_no_more_time_than_there_is_or_is_the_least(seconds: float, pace: float) -> None:
    plan = affordable(FULL, seconds, pace)
    assert all(least <= count <= full for least, count, full in zip(*map(astuple, (LEAST, plan, FULL)), strict=True))
    assert plan == LEAST or pace * plan.rollouts <= seconds


def test_more_time_buys_more_scenarios_until_there_are_all() -> None:
    plans = [affordable(FULL, seconds, 1e-3) for seconds in (0.0, 2.0, 4.0, 5.0, 60.0)]
    assert [plan.held_out for plan in plans] == sorted({plan.held_out for plan in plans})
    assert (plans[0], plans[-1]) == (LEAST, FULL)


def test_fewer_than_the_least_are_kept_where_they_are_asked_for() -> None:
    assert affordable(SampleSizes(held_out=5), 0.0, 1.0).held_out == 5


@pytest.mark.parametrize(
    ("search", "spent", "left"),
    [
        (5, 0.5, BESIDE_SECONDS - 0.5),
        (20, 9, 20 * LEFT_SHARE),
        (3, 9, LEFT_SECONDS),
        (600, 5, 600 * BESIDE_SHARE - 5),
    ],
)
def test_what_is_beside_a_search_is_limited(search: float, spent: float, left: float) -> None:
    assert time_for(search, spent) == pytest.approx(left)


def test_rollouts_are_those_of_both_rounds_with_start_and_paper_of_one_more_and_of_three_scores() -> None:
    plan = SampleSizes(
        finalists=4, sieved=20, draws=3, vertices=4, hard=2, last=1, last_draws=5, confirmed=7, held_out=6
    )
    assert plan.rollouts == 20 + 2 * 9 + 3 * 5 + 7 + 3 * 6
    assert replace(plan, sieved=10).rollouts == plan.rollouts - 2, "half of the first ladder holds"
