"""Ratios, their intervals, and the rule that says who differs."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dualwinch.simulation.ensembles.comparison import Interval
from dualwinch.toolboxes.race.comparison import ErrorRatio, PairComparison, holm, ratio_of

RANDOM = np.random.default_rng(4)


def test_ratio_interval_and_level_are_those_of_a_paired_t_test_of_logarithms() -> None:
    values, references = np.exp(RANDOM.normal(0.1, 1, (2, 40)) + RANDOM.normal(0, 3, 40))
    found = ratio_of(values, references)
    theirs = stats.ttest_rel(np.log(values), np.log(references))
    interval = theirs.confidence_interval(0.95)
    assert found.scenarios == 40
    assert found.interval.estimate == pytest.approx(stats.gmean(values / references))
    assert (found.interval.low, found.interval.high) == pytest.approx((math.exp(interval.low), math.exp(interval.high)))
    assert found.p == pytest.approx(theirs.pvalue)


def test_the_interval_covers_as_often_as_it_says() -> None:
    covered = 0
    for _ in range(1000):
        interval = ratio_of(np.exp(RANDOM.normal(0.5, 1, 30)), np.ones(30)).interval
        covered += interval.low <= math.exp(0.5) <= interval.high
    assert covered / 1000 == pytest.approx(0.95, abs=0.03)


@given(st.lists(st.floats(1e-12, 1e3), min_size=2, max_size=20), st.floats(1e-3, 1e3))
def test_a_ratio_of_two_is_the_inverse_of_that_of_the_other_way_round(errors: list[float], factor: float) -> None:
    values = np.array(errors)
    there, back = ratio_of(values, values[::-1] * factor), ratio_of(values[::-1] * factor, values)
    assert there.interval.estimate * back.interval.estimate == pytest.approx(1)
    assert there.interval.low * back.interval.high == pytest.approx(1)
    assert there.p == pytest.approx(back.p, abs=1e-9)


def test_without_scenarios_or_with_one_nothing_is_known() -> None:
    nothing, one = ratio_of(np.empty(0), np.empty(0)), ratio_of(np.ones(1), 2 * np.ones(1))
    assert math.isnan(nothing.interval.estimate)
    assert nothing.p == one.p == 1
    assert one.interval == Interval(0.5, 0.0, math.inf)
    same = ratio_of(np.ones(3), np.ones(3))
    assert (same.interval.estimate, same.p) == (1, 1)
    assert ratio_of(2 * np.ones(3), np.ones(3)).p == 0


def test_holms_correction_is_that_of_the_literature() -> None:
    """The least level four times, the next three times, and so on; none less than the one before."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.5]) == [1.0, 1.0]
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_correction_rejects_as_holms_steps_do(levels: list[float]) -> None:
    rejected = set()
    for rank, index in enumerate(np.argsort(levels, kind="stable")):
        if levels[index] * (len(levels) - rank) >= 0.05:
            break
        rejected.add(int(index))
    assert {index for index, level in enumerate(holm(levels)) if level < 0.05} == rejected


@pytest.mark.parametrize(
    ("estimate", "level", "differ"),
    [
        (0.5, 0.01, True),
        (0.5, 0.06, False),
        (0.96, 1e-9, False),
        (1.04, 1e-9, False),
        (1.06, 1e-9, True),
        (0.94, 0.0, True),
    ],
)
def test_two_differ_where_it_is_sure_and_it_counts(estimate: float, level: float, differ: bool) -> None:
    ratio = ErrorRatio(9, Interval(estimate, estimate, estimate), level)
    assert PairComparison("a", "b", ratio, level).differ is differ
