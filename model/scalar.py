"""Functions of scalars, for laws that take floats and CasADi symbols alike.

Use these functions instead of `math` or `numpy` in a law. They return a float for floats and a symbol for symbols;
`where`, `maximum`, `minimum` and `sqrt` also take NumPy arrays, so that functions of time alone can be evaluated for
many times at once, and those of parameters for many machines.
"""

from collections.abc import Callable
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from dualwinch.codegen.source.expressions import as_written

Scalar: TypeAlias = Any
"""A float, or a 1×1 `casadi.SX` or `casadi.MX`."""


def present(value: Scalar) -> bool:
    """Whether a number may be other than zero: any symbol, and an array with a non-zero element."""
    if isinstance(value, (int, float)):
        return bool(value)
    return bool(np.any(value)) if isinstance(value, (np.ndarray, np.number)) else True


def has_begun(flag: Scalar) -> Scalar:
    """Whether a state that is 0 before the first sample, then 1, is 1: a steady-state solver may leave round-off."""
    return flag > 0.5


def where(condition: Scalar, value: Scalar, otherwise: Scalar) -> Scalar:
    """`value` where the condition holds, else `otherwise` (both are evaluated).

    Example:
        >>> from dualwinch import where
        >>> where(2.0 > 1.0, 3.0, 4.0)
        3.0
    """
    if isinstance(condition, np.ndarray):
        return np.where(condition, value, otherwise)
    if isinstance(condition, ca.SX) and condition.is_constant():
        return value if float(condition) else otherwise
    if isinstance(condition, bool) and isinstance(value, (int, float)) and isinstance(otherwise, (int, float)):
        return float(value if condition else otherwise)
    selection = ca.if_else(condition, value, otherwise)
    return float(selection) if isinstance(selection, ca.DM) else selection


def both(first: Scalar, second: Scalar) -> Scalar:
    """1 where both conditions hold, else 0 (a product, which compilers can vectorise)."""
    return first * second


def either(first: Scalar, second: Scalar) -> Scalar:
    """1 where at least one condition holds, else 0."""
    if first is True or second is True:
        return 1.0
    return maximum(first, second)


def maximum(first: Scalar, second: Scalar) -> Scalar:
    """The larger of two scalars."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.fmax(first, second)
    return ca.fmax(first, second)


def minimum(first: Scalar, second: Scalar) -> Scalar:
    """The smaller of two scalars."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.fmin(first, second)
    return ca.fmin(first, second)


def clip(value: Scalar, lower: Scalar, upper: Scalar) -> Scalar:
    """The value, limited to [lower, upper].

    Example:
        >>> from dualwinch import clip
        >>> clip(7.0, -5.0, 5.0)
        5.0
    """
    return ca.fmin(ca.fmax(value, lower), upper)


absolute: Callable[[Scalar], Scalar] = ca.fabs
"""|value|."""

sign: Callable[[Scalar], Scalar] = ca.sign
"""-1, 0 or 1."""

tanh: Callable[[Scalar], Scalar] = ca.tanh
"""Hyperbolic tangent."""

sin: Callable[[Scalar], Scalar] = ca.sin
"""Sine of an angle in rad."""

cos: Callable[[Scalar], Scalar] = ca.cos
"""Cosine of an angle in rad."""

exp: Callable[[Scalar], Scalar] = ca.exp
"""Exponential."""

log: Callable[[Scalar], Scalar] = ca.log
"""Natural logarithm."""


floor: Callable[[Scalar], Scalar] = ca.floor
"""Largest whole number that is not larger."""


def sqrt(value: Scalar) -> Scalar:
    """Square root."""
    return np.sqrt(value) if isinstance(value, np.ndarray) else ca.sqrt(value)


def reciprocals(first: Scalar, second: Scalar) -> tuple[Scalar, Scalar]:
    """1/first and 1/second by a single division, as costly as ten products; first × second must not overflow."""
    product = first * second
    with as_written():  # else CasADi turns it back into two divisions
        return second / product, first / product


def power(base: Scalar, exponent: Scalar) -> Scalar:
    """`base` to the `exponent`, for base > 0."""
    return ca.exp(exponent * ca.log(base))


def rounded(value: Scalar) -> Scalar:
    """Nearest integer, halves upwards."""
    return ca.floor(value + 0.5)


def is_odd(number: Scalar) -> Scalar:
    """Whether a whole number is odd; CasADi 3.7.0 has no ``%``."""
    half = number / 2
    return (np.floor(half) if isinstance(half, np.ndarray) else ca.floor(half)) != half


def quantise(value: Scalar, step: Scalar) -> Scalar:
    """The value rounded to a multiple of `step`; unchanged where the step is 0."""
    return value + where(step > 0, step * rounded(value / maximum(step, 1e-100)) - value, 0.0)
