"""Shrunk estimates against normal equations, and their mean square error against that of least squares."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.controllers.estimators.least_squares import Knowledge, ignorance
from dualwinch.controllers.estimators.shrinkage import shrunk

Floats = NDArray[Any]

N, EXEMPT, OTHERS = 6, 3, [0, 1, 2, 4, 5]
ROWS = np.random.default_rng(1).standard_normal((400, N)) @ np.random.default_rng(2).standard_normal((N, N)) * 10
INFORMATION = ROWS.T @ ROWS
CERTAIN = INFORMATION + np.eye(N)
# what the other constants are known by once the exempt one may be anything
MARGINAL = (
    CERTAIN[np.ix_(OTHERS, OTHERS)]
    - np.outer(CERTAIN[OTHERS, EXEMPT], CERTAIN[EXEMPT, OTHERS]) / (CERTAIN[EXEMPT, EXEMPT])
)


def constants(deviations: float, seed: int) -> Floats:
    """Others as many of their standard deviations from 0, in a direction that is drawn; the exempt one is 1."""
    direction = np.random.default_rng(seed).standard_normal(len(OTHERS))
    found = np.ones(N)
    found[OTHERS] = deviations * np.linalg.solve(np.linalg.cholesky(MARGINAL).T, direction / np.linalg.norm(direction))
    return found


def estimates(true: Floats, seed: int) -> tuple[Floats, Floats]:
    """Least squares with the prior, and what shrinkage leaves of it."""
    values = ROWS @ true + np.random.default_rng(seed).standard_normal(len(ROWS))
    estimate = np.linalg.solve(CERTAIN, ROWS.T @ values)
    return estimate, np.array(shrunk(Knowledge(estimate, INFORMATION[np.tril_indices(N)]), N, [EXEMPT]))


def test_where_nothing_is_wrong_shrinkage_leaves_little() -> None:
    squares = np.array([[w[OTHERS] @ MARGINAL @ w[OTHERS] for w in estimates(constants(0, k), k)] for k in range(400)])
    least, shrunk_estimate = squares.mean(axis=0)
    assert least == pytest.approx(len(OTHERS), rel=0.1)
    assert shrunk_estimate < 0.4 * least
    assert np.mean(squares[:, 1] == 0) > 0.2


def test_twenty_deviations_are_those_of_least_squares() -> None:
    for seed in range(20):
        estimate, shrunk_estimate = estimates(constants(20.0, seed), seed)
        assert shrunk_estimate[OTHERS] == pytest.approx(estimate[OTHERS], rel=1e-2)
        assert shrunk_estimate[EXEMPT] == pytest.approx(estimate[EXEMPT], rel=1e-2)


@pytest.mark.parametrize("deviations", [0.0, 1.0, 2.0, 4.0, 8.0])
def test_the_mean_square_error_is_smaller_whatever_the_constants_are(deviations: float) -> None:
    squares = []
    for seed in range(1000):
        true = constants(deviations, seed)
        squares.append([(w - true) @ INFORMATION @ (w - true) for w in estimates(true, seed)])
    least, shrunk_estimate = np.mean(squares, axis=0)
    assert shrunk_estimate < least


@pytest.mark.parametrize("deviations", [0.0, 2.0, 5.0])
def test_the_exempt_constant_is_what_samples_say_once_the_others_are_shrunk(deviations: float) -> None:
    true = constants(deviations, 7)
    estimate, shrunk_estimate = estimates(true, 7)
    values = INFORMATION @ estimate + estimate  # the normal equations' right side
    left = values[EXEMPT] - CERTAIN[EXEMPT, OTHERS] @ shrunk_estimate[OTHERS]
    assert shrunk_estimate[EXEMPT] == pytest.approx(left / CERTAIN[EXEMPT, EXEMPT], rel=1e-9)
    chi2 = estimate[OTHERS] @ (MARGINAL - np.eye(N - 1)) @ estimate[OTHERS]
    assert shrunk_estimate[OTHERS] == pytest.approx(max(0.0, 1 - 3 / chi2) * estimate[OTHERS], rel=1e-6, abs=1e-12)


def test_nothing_is_estimated_before_the_first_sample() -> None:
    known = ignorance(N)
    known.estimate[:] = 1.0
    assert shrunk(known, N, [EXEMPT, 0]) == (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
