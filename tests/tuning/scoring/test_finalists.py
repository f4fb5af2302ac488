"""Which trials are tried in more scenarios: ladders, and further ones where the best that hold may be."""

from collections.abc import Sequence
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.validation import Validated, evenly, screened_by_strata, strata
from dualwinch.tuning.selection_config import SelectionConfig


def trials(objectives: Sequence[float], caution: Sequence[float] = (0.0,)) -> list[Evaluation]:
    """Feasible trials; the nearest bound of each is at some distance, in turns."""
    return [
        Evaluation(
            Candidate({}, ""),
            (value,),
            {"worst.peak_tension <= 6000 N": -caution[number % len(caution)]},
            {},
            {},
            1,
            number=number,
        )
        for number, value in enumerate(objectives)
    ]


def test_the_ladder_goes_from_the_best_to_the_cautious() -> None:
    ordered = trials([1.01**number for number in range(400)])
    found = strata(ordered, 16, SelectionConfig())
    values = [ordered[index].objectives[0] for index in found]
    assert len(found) == 16
    assert found[0] == 0
    assert all(after / before > 1 + SelectionConfig.stratum for before, after in pairwise(values))
    assert 2.5 < values[-1] / values[0] < 4


def test_of_a_rung_the_most_cautious_is_taken() -> None:
    ordered = trials([1.001**number for number in range(4000)], caution=[0.0, 0.5, 0.1, 0.3, 0.2])
    found = strata(ordered, 16, SelectionConfig())
    assert found[0] == 0, "the best is always there"
    assert {ordered[index].clearance for index in found[1:]} == {0.5}


@given(st.integers(0, 300), st.integers(1, 40))
def test_indices_are_spread_evenly_from_the_first_on(count: int, most: int) -> None:
    found = evenly(count, most)
    assert len(found) == min(count, most)
    assert found[:1] == [0][:count]
    gaps = [after - before for before, after in pairwise([*found, count])]
    assert max(gaps, default=0) - min(gaps, default=0) <= 1


@given(st.integers(0, 2399), st.integers(2, 20))
def test_further_ladders_find_the_best_that_holds(first_to_hold: int, most: int) -> None:
    ordered = trials([1.001**number for number in range(2400)])
    seen: list[int] = []

    def held(ladder: Sequence[Evaluation]) -> list[Validated]:
        seen.extend(trial.number for trial in ladder)
        return [(trial, trial) for trial in ladder if trial.number >= first_to_hold]

    first = [ordered[index] for index in (*evenly(2399, most - 1), 2399)]
    met = screened_by_strata(ordered, first, held, lambda: True)
    assert min(trial.number for trial, _ in met) == first_to_hold
    assert len(seen) == len(set(seen)), "no trial is tried twice"


@pytest.mark.parametrize("ladders", [0, 1, 3])
def test_no_further_ladder_is_begun_when_enough_was_spent(ladders: int) -> None:
    ordered, asked = trials([1.01**number for number in range(500)]), []

    def held(ladder: Sequence[Evaluation]) -> list[Validated]:
        asked.append(len(ladder))
        return []

    assert screened_by_strata(ordered, ordered[:8], held, lambda: len(asked) <= ladders) == []
    assert asked == [8] * (1 + ladders)
