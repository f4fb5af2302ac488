"""Trimming: the reserve that takes peaks to a distance from their bound, where that is what is missing or too much."""

from dataclasses import replace
from functools import cache

import pytest

from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.repair import repaired
from dualwinch.tuning.space import ContinuousDimension
from dualwinch.tuning.tuning_problem import tuning_problem

MARGIN, BOUND = 0.005, 6000.0


@cache
def rig() -> TuningProblem:
    return tuning_problem(ensemble="rig")


def trial(reserve: float) -> Candidate:
    return Candidate(rig().start | {RESERVE: reserve}, "hybrid")


def reserve_of(candidate: Candidate, excess: float) -> float | None:
    other = repaired(candidate, excess, rig(), rig().constraints, MARGIN)
    if other is None:
        return None
    assert other.origin == candidate.origin
    assert {name for name in other.point if other.point[name] != candidate.point[name]} == {RESERVE}
    return float(other.point[RESERVE])


@pytest.mark.parametrize(("excess", "reserve"), [(0.003, 148), (-0.015, 40), (-0.002, 118)])
def test_the_reserve_changes_by_what_the_highest_peak_is_off(excess: float, reserve: float) -> None:
    assert reserve_of(trial(100.0), excess) == pytest.approx(reserve)


def test_it_stays_within_the_space() -> None:
    (upper,) = (
        each.upper for each in rig().space.dimensions if isinstance(each, ContinuousDimension) and each.name == RESERVE
    )
    assert reserve_of(trial(upper - 10), 0.015) == upper
    assert reserve_of(trial(10.0), -0.5) == 0
    assert reserve_of(trial(upper), 0.015) is None
    assert reserve_of(trial(0.0), -0.5) is None


def test_a_peak_that_is_near_the_distance_or_far_too_high_is_left_alone() -> None:
    assert reserve_of(trial(100.0), -MARGIN) is None
    assert reserve_of(trial(100.0), 1.1 * rig().selection.repair_most) is None
    assert reserve_of(trial(100.0), float("inf")) is None


def test_without_a_bound_on_peaks_or_a_reserve_that_varies_there_is_nothing_to_trim() -> None:
    others = [each for each in rig().constraints if "peak" not in each.text]
    assert repaired(trial(100.0), 0.003, rig(), others, MARGIN) is None
    fixed = replace(rig(), space=rig().space.without([RESERVE]))
    assert repaired(trial(100.0), 0.003, fixed, rig().constraints, MARGIN) is None
