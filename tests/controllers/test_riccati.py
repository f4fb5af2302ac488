"""Riccati equations by doubling, against SciPy's solver of the matrix pencil."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from dualwinch.model.matrix import Matrix, riccati


def rows(matrix: np.ndarray) -> Matrix:
    return tuple(map(tuple, matrix.tolist()))


@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 3))
def test_it_is_the_stabilising_solution(seed: int, states: int, inputs: int) -> None:
    draws = np.random.default_rng(seed)
    A, B = draws.standard_normal((states, states)), draws.standard_normal((states, inputs))
    Q = np.diag(10 ** draws.uniform(-3, 3, states))
    found = np.array(riccati(rows(A), rows(B @ B.T), rows(Q), 30))
    assert found == pytest.approx(solve_discrete_are(A, B, Q, np.eye(inputs)), rel=1e-6, abs=1e-9 * np.abs(found).max())


def test_each_step_doubles_the_horizon() -> None:
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    Q, X = np.diag([1.0, 0.1]), np.zeros((2, 2))
    for _ in range(8):
        X = Q + A.T @ X @ np.linalg.solve(np.eye(2) + B @ B.T @ X, A)
    assert np.array(riccati(rows(A), rows(B @ B.T), rows(Q), 3)) == pytest.approx(X, rel=1e-12)
