"""Recursive least squares against one batch of normal equations."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dualwinch.controllers.estimators.least_squares import Knowledge, expected, ignorance, learnt, variances

Floats = NDArray[Any]

SCALES = np.array([30.0, 3.0, 1.0, 0.3])


def recursion(rows: Floats, values: Floats, weights: Floats, fades: Floats) -> Knowledge:
    known = ignorance(rows.shape[1])
    for row, value, weight, fade in zip(rows.tolist(), values, weights, fades, strict=True):
        before = expected(known, row, fade)
        known = learnt(known, row, before, weight * (value - before.value), weight, fade)
    return known


def batch(rows: Floats, values: Floats, weights: Floats, fades: Floats) -> tuple[Floats, Floats]:
    """Estimate and covariance by normal equations, every sample as old as it is at the end."""
    counted = weights * np.append(np.cumprod(fades[:0:-1])[::-1], 1.0)
    information = np.eye(rows.shape[1]) + rows.T @ (counted[:, None] * rows)
    return np.linalg.solve(information, rows.T @ (counted * values)), np.linalg.inv(information)


@given(seed=st.integers(0, 2**32 - 1), fade=st.floats(0.5, 1), samples=st.integers(1, 300))
def test_it_is_the_batch_solution_with_the_prior_kept(seed: int, fade: float, samples: int) -> None:
    random = np.random.default_rng(seed)
    rows = random.standard_normal((samples, 4)) * SCALES
    values = rows @ random.standard_normal(4) + random.standard_normal(samples)
    weights, fades = random.choice([0.0, 0.3, 1.0], samples), random.choice([fade, 1.0], samples)
    known = recursion(rows, values, weights, fades)
    estimate, covariance = batch(rows, values, weights, fades)
    assert np.array(known.estimate) == pytest.approx(estimate, rel=1e-9, abs=1e-9)
    assert np.array(variances(known, 4)) == pytest.approx(np.diag(covariance), rel=1e-9, abs=1e-9)


def test_the_expectation_has_the_variance_of_the_covariance() -> None:
    random = np.random.default_rng(3)
    rows, values, ones = random.standard_normal((50, 4)) * SCALES, random.standard_normal(50), np.ones(50)
    known, row = recursion(rows, values, ones, ones), [2.0, -1.0, 0.5, 3.0]
    estimate, covariance = batch(rows, values, ones, ones)
    found = expected(known, row, 1.0)
    assert found.value == pytest.approx(row @ estimate, rel=1e-9)
    assert found.variance == pytest.approx(row @ covariance @ row, rel=1e-9)


def test_what_no_sample_tells_any_more_returns_to_the_prior() -> None:
    known = recursion(np.array([[3.0, 0.0]] * 100), np.full(100, 6.0), np.ones(100), np.ones(100))
    assert known.estimate[0] == pytest.approx(2, rel=1e-2)
    for _ in range(2000):
        still = expected(known, [0.0, 3.0], 0.99)
        known = learnt(known, [0.0, 3.0], still, -3.0 - still.value, 1.0, 0.99)
    assert np.array(known.estimate) == pytest.approx([0, -1], abs=2e-3)
    assert variances(known, 2)[0] == pytest.approx(1, abs=1e-5)
    assert variances(known, 2)[1] == pytest.approx(1 / (1 + 9 / (1 - 0.99)), rel=1e-3)
