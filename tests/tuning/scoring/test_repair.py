"""Repair: the reserve that takes the highest peak back within its bound, where that is what is missing."""

from dataclasses import replace
from functools import cache

import pytest

from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.validation import repaired
from dualwinch.tuning.space import ContinuousDimension
from dualwinch.tuning.tuning_problem import tuning_problem

BOUND = 6000.0


@cache
def rig() -> TuningProblem:
    return tuning_problem(ensemble="rig")


def trial(reserve: float) -> Candidate:
    return Candidate(rig().start | {RESERVE: reserve}, "hybrid")


def reserve_of(candidate: Candidate, excess: float, share: float = 1.0) -> float | None:
    other = repaired(candidate, excess, rig(), share)
    if other is None:
        return None
    assert other.origin == candidate.origin
    assert {name for name in other.point if other.point[name] != candidate.point[name]} == {RESERVE}
    return float(other.point[RESERVE])


@pytest.mark.parametrize(("excess", "share", "reserve"), [(0.003, 1.0, 148), (0.003, 0.5, 124), (-0.002, 1.0, 118)])
def test_the_reserve_is_raised_by_what_the_highest_peak_is_off(excess: float, share: float, reserve: float) -> None:
    assert reserve_of(trial(100.0), excess, share) == pytest.approx(reserve)


def test_it_stays_within_the_space_and_is_never_lowered() -> None:
    (upper,) = (
        each.upper for each in rig().space.dimensions if isinstance(each, ContinuousDimension) and each.name == RESERVE
    )
    assert reserve_of(trial(upper - 10), 0.015) == upper
    assert reserve_of(trial(upper), 0.015) is None
    assert reserve_of(trial(100.0), -0.5) is None
    assert reserve_of(trial(100.0), -rig().selection.back_off) is None


def test_a_peak_that_is_far_too_high_has_other_reasons() -> None:
    assert reserve_of(trial(100.0), 1.1 * rig().selection.repair_most) is None
    assert reserve_of(trial(100.0), float("inf")) is None


def test_without_a_bound_on_peaks_or_a_reserve_that_varies_there_is_nothing_to_repair() -> None:
    free = replace(rig(), constraints=tuple(each for each in rig().constraints if "peak" not in each.text))
    assert repaired(trial(100.0), 0.003, free) is None
    fixed = replace(rig(), space=rig().space.without([RESERVE]))
    assert repaired(trial(100.0), 0.003, fixed) is None
