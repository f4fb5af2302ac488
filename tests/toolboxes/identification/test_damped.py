"""Moves that take back the last one are shortened, others are not."""

import numpy as np
import pytest

from dualwinch.toolboxes.identification.estimate import damped


@pytest.mark.parametrize("ratio", [-0.95, -0.5, 0.0])
def test_a_move_that_comes_back_lands_where_all_would(ratio: float) -> None:
    """The move r and all that would follow, r², r³ and so on, add up to r / (1 - r)."""
    last = np.array([2.0, -1.0])
    move, rest = ratio * last, ratio * last / (1 - ratio)
    np.testing.assert_allclose(damped(move, last), rest)


def test_the_first_move_and_one_that_goes_on_are_whole() -> None:
    move = np.array([1.0, 3.0])
    np.testing.assert_array_equal(damped(move, np.zeros(2)), move)
    np.testing.assert_array_equal(damped(move, 0.5 * move), move)
    np.testing.assert_allclose(damped(move, -0.1 * move), move / 2, err_msg="at most half is taken back")
