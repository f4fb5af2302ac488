"""How much is made of choice and score: all of it without hurry, less beside a short search, never nothing."""

import json
from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.selection_config import SampleSizes, SelectionConfig

CONFIG = SelectionConfig()
FULL, LEAST = CONFIG.sizes, CONFIG.least_sizes


@given(st.floats(0, 1e3), st.floats(1e-6, 1))
def test_what_is_affordable_takes_no_more_time_than_there_is_or_is_the_least(seconds: float, pace: float) -> None:
    sizes = CONFIG.affordable(FULL, seconds, pace)
    assert all(least <= count <= full for least, count, full in zip(*map(astuple, (LEAST, sizes, FULL)), strict=True))
    assert sizes == LEAST or (1 + CONFIG.time_caution) * pace * sizes.rollouts <= seconds


def test_more_time_buys_more_scenarios_until_there_are_all() -> None:
    sizess = [CONFIG.affordable(FULL, seconds, 1e-3) for seconds in (0.0, 2.0, 4.0, 60.0)]
    assert [sizes.test for sizes in sizess] == sorted({sizes.test for sizes in sizess})
    assert (sizess[0], sizess[-1]) == (LEAST, FULL)


def test_fewer_than_the_least_are_kept_where_they_are_asked_for() -> None:
    assert CONFIG.affordable(SampleSizes(test=5), 0.0, 1.0).test == 5


@pytest.mark.parametrize(("preparing", "searching"), [(8.0, 60.0), (40.0, 40.0), (80.0, 6.0)])
def test_a_search_is_as_long_as_is_asked_for_unless_preparing_took_long(preparing: float, searching: float) -> None:
    assert CONFIG.time_of_all(60.0) == pytest.approx(88.0)
    assert CONFIG.time_of_search(60.0, 88.0 - preparing) == pytest.approx(searching)


def test_rollouts_are_those_of_half_the_screening_with_start_and_paper_and_of_two_candidates_and_three_scores() -> None:
    sizes = SampleSizes(candidates=4, screening_rollouts=20, draws=3, vertices=4, chance=9, test=6)
    assert sizes.rollouts == 4 * 7 // 2 + 2 * 7 + 2 * 9 + 3 * 6
    assert replace(sizes, screening_rollouts=40).rollouts == sizes.rollouts + 6


@pytest.mark.parametrize("words", [{"violation": 0.0}, {"violation": 1.0}, {"confidence": 95.0}])
def test_probabilities_lie_between_0_and_1(words: dict[str, float]) -> None:
    with pytest.raises(ConfigurationError, match="must be > 0 and < 1"):
        replace(CONFIG, **words)


def test_a_configuration_is_kept_with_a_study() -> None:
    asked = replace(CONFIG, back_off=0.01, margin_amplitudes=(0.02,), sizes=SampleSizes(test=7))
    assert SelectionConfig.from_record(json.loads(json.dumps(asked.to_record()))) == asked
