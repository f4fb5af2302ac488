import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.matrix import Matrix, diagonal, plus, solve, times, transpose

matrices = st.lists(st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(tuple), min_size=3, max_size=3).map(tuple)


@given(matrices, matrices)
def test_products_and_sums(a: Matrix, b: Matrix) -> None:
    assert np.array(times(a, b, a)) == pytest.approx(np.array(a) @ np.array(b) @ np.array(a))
    assert np.array(plus(a, transpose(b))) == pytest.approx(np.array(a) + np.array(b).T)


@given(matrices, matrices)
def test_solution_of_a_linear_equation(a: Matrix, b: Matrix) -> None:
    dominant = plus(a, diagonal(4.0, 5.0, 6.0))
    assert times(dominant, solve(dominant, b)) == pytest.approx(np.array(b), abs=1e-12)
