import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.matrix import Matrix, diagonal, factorised, plus, solve, solved, times, transpose

matrices = st.lists(st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(tuple), min_size=3, max_size=3).map(tuple)


@given(matrices, matrices)
def test_products_and_sums(a: Matrix, b: Matrix) -> None:
    assert np.array(times(a, b, a)) == pytest.approx(np.array(a) @ np.array(b) @ np.array(a))
    assert np.array(plus(a, transpose(b))) == pytest.approx(np.array(a) + np.array(b).T)


@given(matrices, matrices)
def test_solution_of_a_linear_equation(a: Matrix, b: Matrix) -> None:
    dominant = plus(a, diagonal(4.0, 5.0, 6.0))
    assert times(dominant, solve(dominant, b)) == pytest.approx(np.array(b), abs=1e-12)


@given(st.lists(st.floats(-1e4, 1e4), min_size=12, max_size=12), st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_factors_solve_for_an_identity_with_information_added(rows: list[float], b: list[float]) -> None:
    information = np.array(rows).reshape(3, 4)
    a = np.eye(4) + information.T @ information
    x = np.array(solved(factorised(tuple(map(tuple, a))), b))
    residual = a @ x - b
    assert np.abs(residual).max() <= 1e-10 * (np.abs(a) @ np.abs(x) + np.abs(b)).max()


def test_a_pivot_that_round_off_has_spoilt_counts_as_one() -> None:
    spoilt = ((1e20,), (1e20, 1e20 - 1e6))
    lower, inverses = factorised(spoilt)
    assert (lower[1][0], inverses[1]) == (1.0, 1.0)
