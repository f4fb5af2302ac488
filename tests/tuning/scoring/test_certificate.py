"""The certificate: what draws support, against the binomial distribution itself."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.scoring.certificate import (
    SampleCertificate,
    clopper_pearson,
    draws_needed,
    is_unlikely,
    series,
    upper_limit,
)

DEFAULT = SampleCertificate(TuningOptions.violation, TuningOptions.confidence)


@given(st.floats(1e-3, 0.3), st.floats(1e-4, 0.4), st.integers(0, 9))
def test_the_draws_needed_are_the_fewest_that_support_a_probability(
    violation: float, error: float, violations: int
) -> None:
    needed = draws_needed(violation, error, violations)
    assert binom.cdf(violations, needed, violation) <= error * (1 + 1e-9)
    assert needed - 1 <= violations or binom.cdf(violations, needed - 1, violation) > error * (1 - 1e-9)


@given(st.integers(1, 500), st.data())
def test_limits_make_so_few_violations_as_rare_as_asked(draws: int, data: st.DataObject) -> None:
    violations = data.draw(st.integers(0, draws - 1))
    limit = upper_limit(violations, draws, 0.03)
    assert binom.cdf(violations, draws, limit) == pytest.approx(0.03, rel=1e-6)
    assert upper_limit(draws, draws, 0.03) == 1


@given(st.integers(1, 300), st.data())
def test_intervals_are_those_of_the_exact_binomial_test(draws: int, data: st.DataObject) -> None:
    violations = data.draw(st.integers(0, draws))
    theirs = binomtest(violations, draws).proportion_ci(0.9, "exact")
    assert clopper_pearson(violations, draws, 0.9) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_the_parts_of_an_error_add_up_to_it() -> None:
    assert sum(series(0.05, number) for number in range(1, 20_000)) == pytest.approx(0.05, rel=1e-4)


def test_stages_allow_more_violations_in_more_draws() -> None:
    sizes = [DEFAULT.draws_of_stage(violations) for violations in range(4)]
    assert sizes == sorted(set(sizes))
    for violations, draws in enumerate(sizes):
        assert replace(DEFAULT, draws=draws, violations=violations).satisfied
        assert not replace(DEFAULT, draws=draws, violations=violations + 1).satisfied


def test_a_candidate_that_violates_bounds_more_often_than_asked_is_rarely_certified() -> None:
    """The error of all stages together is at most β, by simulation."""
    certificate, random = SampleCertificate(0.05, 0.9), np.random.default_rng(0)
    sizes = [certificate.draws_of_stage(violations) for violations in range(12)]
    draws = random.random((2000, sizes[-1])) < 0.05
    counts = draws.cumsum(axis=1)
    passed = np.zeros(len(draws), bool)
    for violations, size in enumerate(sizes):
        passed |= counts[:, size - 1] <= violations
    assert 0.01 < passed.mean() <= 0.1


def test_a_rejection_takes_more_violations_than_chance_explains() -> None:
    assert not is_unlikely(0, 10_000, 0.005, 0.05)
    assert not is_unlikely(1, 64, 0.005, 0.05)
    assert is_unlikely(2, 64, 0.005, 0.05)
    assert not is_unlikely(5, 797, 0.005, 0.05)
    assert is_unlikely(9, 797, 0.005, 0.05)


def test_a_margin_below_its_bound_or_a_violated_mean_is_no_certificate() -> None:
    passed = replace(DEFAULT, draws=DEFAULT.draws_of_stage(0), machines=59)
    assert passed.satisfied
    assert passed.machine_share < 0.06
    assert not replace(passed, machines_below=1).satisfied
    assert not replace(passed, means={"mean.chatter <= 4 N": 0.1}).satisfied
    assert not replace(passed, draws=0).satisfied


def test_words_say_what_is_supported_and_by_what() -> None:
    draws = DEFAULT.draws_of_stage(0)
    passed = replace(DEFAULT, draws=draws, machines=59)
    (words,) = passed.sentences
    assert words == (
        f"certified with 95 % confidence: bounds hold in ≥ 99.5 % of draws (0 of {draws} fresh ones violate one), "
        "and margins hold on ≥ 94.25 % of machines (0 of 59 fresh ones below)"
    )


def test_words_say_why_nothing_is_certified_and_what_is_supported_instead() -> None:
    few = replace(DEFAULT, draws=448, machines=59)
    obstacle, support = few.sentences
    assert obstacle == "not certified: 448 fresh draws, 0 of which violate a bound, are too few for 99.5 %"
    assert support == (
        "with 95 % confidence, bounds hold in ≥ 99.11 % of draws (0 of 448 fresh ones violate one), "
        "and margins hold on ≥ 94.25 % of machines (0 of 59 fresh ones below)"
    )
    below = replace(DEFAULT, machines=6, machines_below=1)
    assert below.sentences[0] == "not certified: on 1 of 6 fresh machines a margin is below its bound"
    assert replace(DEFAULT, machines=59).sentences[0] == "not certified: no fresh draws were run"
    assert DEFAULT.sentences == ["not certified: no fresh draws were run"]
    many = replace(few, draws=64, violations=6)
    assert many.rejected
    assert many.sentences[0] == "not certified: 6 of 64 fresh draws violate a bound, more than 99.5 % allows"
    passed = replace(few, draws=DEFAULT.draws_of_stage(0))
    mean = replace(passed, means={"mean.chatter <= 4 N": 0.1})
    assert mean.sentences[0] == "not certified: over the fresh draws, mean.chatter <= 4 N is violated"
