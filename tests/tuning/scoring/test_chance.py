"""Chance constraint: probabilities that draws support, against the binomial distribution itself."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from dualwinch.tuning.scoring.chance import ChanceConstraint, clopper_pearson, draws_needed
from dualwinch.tuning.selection_config import SampleSizes, SelectionConfig


def constraint(draws: int, violations: int = 0, violation: float = 0.005) -> ChanceConstraint:
    return ChanceConstraint(violation, 0.95, 3, draws, violations)


@given(st.floats(1e-3, 0.2), st.floats(0.5, 0.999), st.integers(1, 20))
def test_none_of_as_many_draws_as_are_needed_is_enough(violation: float, confidence: float, candidates: int) -> None:
    needed = draws_needed(violation, confidence, candidates)
    assert ChanceConstraint(violation, confidence, candidates, needed, 0).satisfied
    assert candidates * binom.pmf(0, needed, violation) <= 1 - confidence + 1e-12


def test_the_default_number_of_draws_is_that_of_the_default_probabilities() -> None:
    config = SelectionConfig()
    assert SampleSizes().chance == draws_needed(config.violation, config.confidence, config.chance_candidates) == 819


@given(st.integers(1, 500), st.data())
def test_draws_support_what_makes_so_few_violations_as_rare_as_asked(draws: int, data: st.DataObject) -> None:
    violations = data.draw(st.integers(0, draws - 1))
    found = constraint(draws, violations)
    assert binom.cdf(violations, draws, found.supported) == pytest.approx(0.05 / 3, rel=1e-6)
    assert constraint(draws, draws).supported == 1


@given(st.integers(1, 300), st.data())
def test_intervals_are_those_of_the_exact_binomial_test(draws: int, data: st.DataObject) -> None:
    violations = data.draw(st.integers(0, draws))
    theirs = binomtest(violations, draws).proportion_ci(0.9, "exact")
    assert clopper_pearson(violations, draws, 0.9) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_words_say_what_is_known_and_what_is_missing() -> None:
    assert constraint(819).words == (
        "bounds on runs are satisfied with probability ≥ 99.5 % (95 % confidence: no violations in 819 fresh draws)"
    )
    assert constraint(100).words == (
        "bounds on runs are satisfied with probability ≥ 95.98 % (95 % confidence: no violations in 100 fresh draws, "
        "819 are needed; asked for: 99.5 %)"
    )
    one = constraint(819, 1)
    assert not one.satisfied
    assert "1 violation in 819 fresh draws; asked for: 99.5 %" in one.words
