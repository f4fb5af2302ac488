"""Statements of a function in C99 of one precision, on the named members of structures."""

import re
from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np

from dualwinch.codegen.block import Variable
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.c_source import generated

Precision: TypeAlias = Literal["double", "float"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)

LIBRARY = ("exp", "log", "pow", "sin", "cos", "sqrt", "tanh", "floor", "fabs")
"""Functions of math.h that a block may call; in single precision their names end in f."""

OWN = {"casadi_fmin": "smaller", "casadi_fmax": "larger", "casadi_sq": "square", "casadi_fabs": "fabs"}
"""CasADi's helpers and what stands for them in a package."""

LITERAL = re.compile(r"(?<![\w.\[])\d+\.\d*(?:e[+-]?\d+)?")
TRUTH, FALSEHOOD = re.compile(r"\((a\d+)\?"), re.compile(r"\(!(a\d+)\)")
"""Numbers taken as truth values; written out as comparisons, which no compiler takes for a lossy conversion."""

CALL = re.compile(r"(?<![\w.])([a-z_]\w*)\(")


def member(variable: Variable) -> str:
    """Name of a variable as a member of a C structure."""
    return re.sub(r"\W", "_", variable.name)


def literal(value: float, precision: Precision) -> str:
    """A finite number as a C constant of a precision.

    In single precision a number that is too small or too large for it becomes the smallest or largest there is:
    guards against a division by zero stay guards.
    """
    if precision == "double":
        return repr(float(value))
    limits = np.finfo(np.float32)
    if value != 0:
        value = float(np.copysign(np.clip(abs(value), limits.tiny, limits.max), value))
    return f"{np.float32(value)!s}f"


def c_body(function: ca.Function, places: Mapping[str, tuple[str, tuple[Variable, ...]]], precision: Precision) -> str:
    """Declarations and statements of a function.

    Args:
        function: of SX expressions, with dense vectors.
        places: name of an argument or result → what its members stand behind (e.g. ``state->``), and the variables.
        precision: of every number and every operation.

    Raises:
        CodegenError: the function holds something that is no plain C.
    """
    _, (body,) = generated([function])
    for name in function.name_out():
        body = body.replace(f"if ({name}) {name}[", f"{name}[")
    for name, (before, variables) in places.items():
        members = [before + member(variable) for variable in variables]
        body = re.sub(rf"\b{name}\[(\d+)\]", lambda found, m=members: m[int(found[1])], body)
    body = LITERAL.sub(lambda found: literal(float(found[0]), precision), body)
    body = TRUTH.sub(r"(\1!=0?", FALSEHOOD.sub(r"(\1==0)", body))
    body = CALL.sub(lambda found: f"{_called(found[1], precision)}(", body)
    return body.replace("casadi_real", "real")


def _called(name: str, precision: Precision) -> str:
    name = OWN.get(name, name)
    if name in LIBRARY:
        return name if precision == "double" else f"{name}f"
    if name not in OWN.values():
        raise CodegenError(f"{name}: no such function in a C package")
    return name
