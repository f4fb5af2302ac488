"""Quadratic programs within a box, beside a solver that shares nothing with it."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.laws.predictive.box import least_in_box


def problem(seed: int, n: int) -> tuple[Any, Any, Any, Any]:
    """A random problem: positive definite, its box around zero."""
    draws = np.random.default_rng(seed)
    root = draws.standard_normal((n, n))
    lower, upper = -draws.uniform(0, 1, n), draws.uniform(0, 1, n)
    return root @ root.T + 0.1 * np.eye(n), 3 * draws.standard_normal(n), lower, upper


def solved(quadratic: np.ndarray, linear: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """By DAQP, a dual active-set method."""
    solver = ca.conic("reference", "daqp", {"h": ca.Sparsity.dense(*quadratic.shape), "a": ca.Sparsity(0, len(linear))})
    return np.array(solver(h=quadratic, g=linear, lbx=lower, ubx=upper)["x"]).ravel()


def started(n: int) -> list[float]:
    return [0.0] * n


@given(st.integers(0, 10**6), st.integers(1, 8))
def test_a_guess_that_has_settled_is_the_solution(seed: int, n: int) -> None:
    given = problem(seed, n)
    values, sides = least_in_box(*given, started(n), 30)
    again, after = least_in_box(*given, sides, 1)
    if after == sides:
        assert values == pytest.approx(solved(*given), abs=1e-7)
        assert again == pytest.approx(values, abs=1e-9)


def test_it_settles_in_a_few_iterations_nearly_always() -> None:
    settled = 0
    for seed in range(300):
        given = problem(seed, 6)
        values, _ = least_in_box(*given, started(6), 6)
        settled += np.abs(np.subtract(values, solved(*given))).max() < 1e-7
    assert settled >= 295


def test_without_bounds_one_iteration_is_exact() -> None:
    quadratic, linear, *_ = problem(3, 6)
    values, sides = least_in_box(quadratic, linear, [-1e9] * 6, [1e9] * 6, started(6), 1)
    assert values == pytest.approx(np.linalg.solve(quadratic, -linear), rel=1e-9)
    assert sides == started(6)


def test_the_right_guess_is_kept() -> None:
    """So one iteration a sample is enough as long as the same bounds hold."""
    quadratic, linear, lower, upper = problem(5, 6)
    _, sides = least_in_box(quadratic, linear, lower, upper, started(6), 8)
    assert any(sides)
    values, after = least_in_box(quadratic, 1.001 * linear, lower, upper, sides, 1)
    assert after == sides
    assert values == pytest.approx(solved(quadratic, 1.001 * linear, lower, upper), abs=1e-7)


def test_symbols_give_what_floats_give() -> None:
    quadratic, linear, lower, upper = problem(7, 4)
    symbols = ca.SX.sym("g", 4)
    values, sides = least_in_box(quadratic.tolist(), ca.vertsplit(symbols), lower, upper, started(4), 3)
    found = ca.Function("least", [symbols], [ca.vertcat(*values), ca.vertcat(*sides)])(linear)
    expected = least_in_box(quadratic.tolist(), linear.tolist(), lower.tolist(), upper.tolist(), started(4), 3)
    for ours, theirs in zip(found, expected, strict=True):
        assert np.array(ours).ravel() == pytest.approx(theirs, rel=1e-12)
