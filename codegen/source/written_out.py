"""Functions that Structured Text lacks, as expressions of functions of every PLC language.

C packages use them too, so that both have the same operations in the same order. Besides + − × / and comparisons they
need only `sqrt`, `exp`, `log` and `atan`; each docstring states the largest relative error in units in the last place
(ulp) if those are within 1 ulp, as measured by `tests/codegen/source/test_written_out.py`.
"""

import math
import sys
from collections.abc import Callable

import casadi as ca

from dualwinch.codegen.source.casadi_c import lacking
from dualwinch.codegen.source.expressions import GRAPHS, applied, as_written, instructions, operands_of

MOST_FACTORS = 64
"""Largest integer power that is written as a product."""

OVERFLOW = 2 * math.log(sys.float_info.max)
"""Argument of exp that overflows, with its negative giving 0, even in double precision."""


def tanh(x: ca.SX) -> ca.SX:
    """Tanh within 2 ulp: a rational function below 0.625 (Cephes, after Cody and Waite), from exp(2|x|) beyond."""
    size = ca.fmin(ca.fabs(x), 20)  # where it is 1
    square = size * size
    above = (-0.964399179425052238628 * square - 99.2877231001918586564) * square - 1614.68768441708447952
    below = ((square + 112.811678491632931402) * square + 2235.48839060100448583) * square + 4844.06305325125486048
    near = x + x * (square * (above / below))
    far = ca.sign(x) * (1 - 2 / (ca.exp(2 * size) + 1))
    return ca.if_else(size < 0.625, near, far)


def expm1(x: ca.SX) -> ca.SX:
    """Compute exp(x) − 1 within 4 ulp, from exp and log, whose roundings cancel (Kahan)."""
    grown = ca.exp(x)
    near = (grown - 1) * x / ca.if_else(grown == 1, 1, ca.log(grown))
    return ca.if_else(grown == 1, x, ca.if_else(ca.fabs(x) < 1, near, grown - 1))


def log1p(x: ca.SX) -> ca.SX:
    """Compute log(1 + x) within 4 ulp (Kahan; Goldberg, What every computer scientist should know, theorem 4)."""
    shifted = 1 + x
    return ca.if_else(shifted == 1, x, ca.log(shifted) * x / ca.if_else(shifted == 1, 1, shifted - 1))


def sinh(x: ca.SX) -> ca.SX:
    """Sinh within 8 ulp for |x| ≤ 700, where exp is finite."""
    grown = expm1(ca.fabs(x))
    return ca.sign(x) * ((grown + grown / (grown + 1)) / 2)


def cosh(x: ca.SX) -> ca.SX:
    """Cosh within 4 ulp for |x| ≤ 700."""
    grown = ca.exp(ca.fabs(x))
    return (grown + 1 / grown) / 2


def asinh(x: ca.SX) -> ca.SX:
    """Asinh within 8 ulp for |x| ≤ 1e150."""
    size = ca.fabs(x)
    return ca.sign(x) * log1p(size + size * size / (1 + ca.sqrt(size * size + 1)))


def acosh(x: ca.SX) -> ca.SX:
    """Acosh within 8 ulp for x ≤ 1e150."""
    excess = x - 1
    return log1p(excess + ca.sqrt(2 * excess + excess * excess))


def atanh(x: ca.SX) -> ca.SX:
    """Atanh within 8 ulp."""
    size = ca.fabs(x)
    return ca.sign(x) * (log1p(2 * size / (1 - size)) / 2)


def power(x: ca.SX, y: ca.SX) -> ca.SX:
    """x^y, NaN for x < 0 unless y is an integer.

    A product within y ulp for constant integers y up to `MOST_FACTORS`, else exp(y log|x|) within 4 + 2 |y log|x|| ulp.
    """
    if y.is_constant() and float(y).is_integer() and abs(float(y)) <= MOST_FACTORS:
        result, factor, exponent = ca.SX(1), x, abs(int(float(y)))
        while exponent:
            result = (result * factor if not result.is_constant() else factor) if exponent % 2 else result
            factor, exponent = factor * factor if exponent > 1 else factor, exponent // 2
        return result if float(y) >= 0 else 1 / result
    size, integral, even = ca.fabs(x), ca.floor(y) == y, 2 * ca.floor(y / 2) == y
    logarithm = y * ca.log(ca.if_else(size == 0, 1, size))
    grown = ca.exp(ca.if_else(size == 0, -OVERFLOW * ca.sign(y), logarithm))  # for size 0: 0, 1 or infinity
    undefined = ca.logic_and(x < 0, ca.logic_not(integral))
    signed = grown * ca.sqrt(ca.if_else(undefined, -1, 1))
    return ca.if_else(ca.logic_and(x < 0, ca.logic_not(even)), -signed, signed)


def hypot(x: ca.SX, y: ca.SX) -> ca.SX:
    """√(x² + y²) within 2 ulp, without overflow."""
    large, small = ca.fmax(ca.fabs(x), ca.fabs(y)), ca.fmin(ca.fabs(x), ca.fabs(y))
    ratio = small / ca.if_else(large == 0, 1, large)
    return large * ca.sqrt(1 + ratio * ratio)


def atan2(y: ca.SX, x: ca.SX) -> ca.SX:
    """The angle of (x, y) within 4 ulp; that of (0, 0) is 0."""
    steep = ca.fabs(y) > ca.fabs(x)
    over = ca.if_else(steep, y, x)
    angle = ca.atan(ca.if_else(steep, x, y) / ca.if_else(over == 0, 1, over))
    flat = angle + ca.if_else(x < 0, ca.if_else(y < 0, -math.pi, math.pi), 0)
    return ca.if_else(steep, ca.if_else(y < 0, -math.pi / 2, math.pi / 2) - angle, flat)


def fmod(x: ca.SX, y: ca.SX) -> ca.SX:
    """Remainder of x/y truncated, with the sign of x: within 1 ulp of x."""
    ratio = x / y
    return x - y * (ca.sign(ratio) * ca.floor(ca.fabs(ratio)))


def remainder(x: ca.SX, y: ca.SX) -> ca.SX:
    """Difference of x from the nearest multiple of y, within 1 ulp of x; in a tie, that of the larger quotient."""
    return x - y * ca.floor(x / y + 0.5)


def erf(x: ca.SX) -> ca.SX:
    """Error function within 16 ulp.

    A series of positive terms below 3 (Abramowitz and Stegun 7.1.6), the continued fraction of erfc above (7.1.14).
    """
    size = ca.fmin(ca.fabs(x), 6)  # where it is 1
    square = size * size
    fall = ca.exp(-square)
    total = ca.SX(1)
    for term in range(60, 0, -1):
        total = 1 + total * (square * (2 / (2 * term + 1)))
    fraction = size
    for term in range(40, 0, -1):
        fraction = size + (term / 2) / fraction
    near = (2 / math.sqrt(math.pi)) * size * fall * total
    far = 1 - fall / (math.sqrt(math.pi) * ca.if_else(size < 3, 1, fraction))
    return ca.sign(x) * ca.if_else(size < 3, near, far)


WRITTEN_OUT: dict[int, Callable[..., ca.SX]] = {
    ca.OP_TANH: tanh,
    ca.OP_EXPM1: expm1,
    ca.OP_LOG1P: log1p,
    ca.OP_SINH: sinh,
    ca.OP_COSH: cosh,
    ca.OP_ASINH: asinh,
    ca.OP_ACOSH: acosh,
    ca.OP_ATANH: atanh,
    ca.OP_POW: power,
    ca.OP_CONSTPOW: power,
    ca.OP_HYPOT: hypot,
    ca.OP_ATAN2: atan2,
    ca.OP_FMOD: fmod,
    ca.OP_REMAINDER: remainder,
    ca.OP_ERF: erf,
}
"""Operation → its replacement."""


@GRAPHS.cached
def written_out(function: ca.Function) -> ca.Function:
    """The function with the replacements `WRITTEN_OUT`; the function itself if none is needed.

    Args:
        function: function of dense SX expressions; unchanged if the emitter has no C for it.
    """
    if lacking(function) or not any(instruction.operation in WRITTEN_OUT for instruction in instructions(function)):
        return function
    operands = operands_of(function)
    with as_written():
        inputs = [ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()]
        elements = [ca.vertsplit(vector) if vector.numel() else [] for vector in inputs]
        outputs = [[ca.SX(0)] * function.numel_out(name) for name in function.name_out()]
        values: dict[int, ca.SX] = {}
        for step, (operation, read, written, constant) in enumerate(instructions(function)):
            operand_values = [values[operand] for operand in operands.get(step, ())]
            if operation == ca.OP_INPUT:
                values[step] = elements[read[0]][read[1]]
            elif operation == ca.OP_CONST:
                values[step] = ca.SX(constant)
            elif operation == ca.OP_OUTPUT:
                outputs[written[0]][written[1]] = operand_values[0]
            else:
                replaced = WRITTEN_OUT.get(operation)
                values[step] = replaced(*operand_values) if replaced else applied(operation, operand_values)
        results = [ca.vertcat(*column) if column else ca.SX(0, 1) for column in outputs]
        return ca.Function(function.name(), inputs, results, function.name_in(), function.name_out(), {"cse": True})
