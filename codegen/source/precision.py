"""Single and double precision in C: how numbers and calls of the C library are written."""

import math
from typing import Literal, TypeAlias, get_args

import numpy as np

Precision: TypeAlias = Literal["double", "float"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)


def literal(value: float, precision: Precision) -> str:
    """A number as a C constant of a precision.

    In single precision a finite number that is too small or too large for it becomes the smallest or largest there
    is: guards against a division by zero stay guards.
    """
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    if precision == "double":
        return repr(float(value))
    limits = np.finfo(np.float32)
    if value != 0:
        value = float(np.copysign(np.clip(abs(value), limits.tiny, limits.max), value))
    return f"{np.float32(value)!s}f"


def suffix(precision: Precision) -> str:
    """What the names of functions of math.h end in."""
    return "f" if precision == "float" else ""
