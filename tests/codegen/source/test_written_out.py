"""Functions that Structured Text lacks, beside those of extended precision."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.special import erf

from dualwinch.codegen.source.expressions import instructions
from dualwinch.codegen.source.written_out import WRITTEN_OUT, written_out
from dualwinch.toolboxes.plc.operations import CHOICES, CONDITIONS, EXPRESSIONS

RANDOM = np.random.default_rng(0)
SIZES = 10.0 ** RANDOM.uniform(-12, 1.3, 4000)
BOTH = SIZES * RANDOM.choice([-1, 1], SIZES.size)
OTHER = RANDOM.permutation(BOTH)

OF_ONE = {
    ca.OP_TANH: (np.tanh, BOTH, 2),
    ca.OP_EXPM1: (np.expm1, BOTH, 4),
    ca.OP_LOG1P: (np.log1p, np.concatenate([SIZES, -SIZES / 21]), 4),
    ca.OP_SINH: (np.sinh, BOTH, 8),
    ca.OP_COSH: (np.cosh, BOTH, 4),
    ca.OP_ASINH: (np.arcsinh, BOTH, 8),
    ca.OP_ACOSH: (np.arccosh, 1 + SIZES, 8),
    ca.OP_ATANH: (np.arctanh, BOTH / 21, 8),
    ca.OP_ERF: (lambda x: erf(np.asarray(x, float)), BOTH, 16),
}
"""Operation → the function, where it is compared, and the error in ulp that its docstring states."""

OF_TWO = {ca.OP_HYPOT: (np.hypot, 2), ca.OP_ATAN2: (np.arctan2, 4)}


def values(operation: int, *at: np.ndarray, power: float | None = None) -> np.ndarray:
    symbols = [ca.SX.sym("x"), *([ca.SX.sym("y")] if len(at) == 2 else [])]
    operands = [*symbols, *([ca.SX(power)] if power is not None else [])]
    result = ca.SX.unary(operation, *operands) if len(operands) == 1 else ca.SX.binary(operation, *operands)
    function = written_out(ca.Function("f", symbols, [result]))
    writable = {*EXPRESSIONS, *CONDITIONS, *CHOICES, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    assert {made.operation for made in instructions(function)} <= writable
    return np.array(function.map(len(at[0]))(*(part[None] for part in at))).ravel()


def ulps(got: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Distance in units of the last place of the wanted values, which are of extended precision."""
    spacing = np.spacing(np.abs(wanted.astype(float)))
    return np.asarray(np.abs(got - wanted) / spacing, float)


@pytest.mark.parametrize("operation", OF_ONE)
def test_functions_of_one_are_within_the_stated_error(operation: int) -> None:
    function, at, error = OF_ONE[operation]
    wide: Callable[[np.ndarray], np.ndarray] = function
    assert ulps(values(operation, at), wide(at.astype(np.longdouble))).max() < error
    origin = float(operation == ca.OP_ACOSH)
    assert values(operation, np.array([origin])) == function(origin)


@pytest.mark.parametrize("operation", OF_TWO)
def test_functions_of_two_are_within_the_stated_error(operation: int) -> None:
    function, error = OF_TWO[operation]
    wide = function(BOTH.astype(np.longdouble), OTHER.astype(np.longdouble))
    assert ulps(values(operation, BOTH, OTHER), wide).max() < error
    at = np.array([[y, x] for y in (0.0, 1.0, -1.0) for x in (0.0, 1.0, -1.0)]).T
    np.testing.assert_allclose(values(operation, *at), function(*at), rtol=1e-15)


@pytest.mark.parametrize("power", [3.0, 17.0, -2.0, 0.0])
def test_whole_powers_are_products(power: float) -> None:
    wide = BOTH.astype(np.longdouble) ** power
    assert ulps(values(ca.OP_POW, BOTH, power=power), wide).max() < max(abs(power), 2)


def test_powers_are_within_the_stated_error_and_have_their_signs() -> None:
    wide, allowed = SIZES.astype(np.longdouble) ** OTHER, 4 + 2 * np.abs(OTHER * np.log(SIZES))
    kept = np.isfinite(wide.astype(float)) & (wide.astype(float) > 1e-300)
    assert (ulps(values(ca.OP_POW, SIZES, OTHER), wide)[kept] < allowed[kept]).all()
    x, y = np.array([[-2, 3], [-2, 2], [-2, -3], [0, 0], [0, 2], [0, -1], [3, 0], [-2, 2.5]], float).T
    np.testing.assert_allclose(values(ca.OP_POW, x, y), [-8, 4, -0.125, 1, 0, np.inf, 1, np.nan], rtol=1e-14)


def test_remainders_are_those_of_the_c_library() -> None:
    x, y = np.array([[7, 3], [-7, 3], [7, -3], [5.5, 2], [1, 10]], float).T
    np.testing.assert_array_equal(values(ca.OP_FMOD, x, y), np.fmod(x, y))
    np.testing.assert_array_equal(values(ca.OP_REMAINDER, x, y), [1, -1, 1, -0.5, 1])


def test_a_function_without_them_stays_itself() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [ca.exp(x) * ca.fmin(x, 1)])
    assert written_out(function) is function
    assert set(WRITTEN_OUT).isdisjoint({*EXPRESSIONS, *CONDITIONS, *CHOICES})
