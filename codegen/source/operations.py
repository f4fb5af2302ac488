"""C text of numbers and of each operation of CasADi's SX expressions, in single and double precision."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from string import Template
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np

Precision: TypeAlias = Literal["double", "float"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)

Generator: TypeAlias = Literal["dualwinch", "casadi"]
"""Generator of C: the emitter of `codegen.source`, or CasADi's ``CodeGenerator``."""


def literal(value: float, precision: Precision) -> str:
    """A number as a C constant of a precision.

    In single precision a finite number beyond its range becomes the smallest or largest one, so that guards against a
    division by zero remain effective.
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
    """Suffix of the functions of math.h."""
    return "f" if precision == "float" else ""


OPERATORS = {
    ca.OP_ADD: "({0}+{1})",
    ca.OP_SUB: "({0}-{1})",
    ca.OP_MUL: "({0}*{1})",
    ca.OP_DIV: "({0}/{1})",
    ca.OP_NEG: "(-{0})",
    ca.OP_INV: "(1/{0})",
    ca.OP_SQ: "({0}*{0})",
    ca.OP_TWICE: "(2*{0})",
    ca.OP_LT: "({0}<{1})",
    ca.OP_LE: "({0}<={1})",
    ca.OP_EQ: "({0}=={1})",
    ca.OP_NE: "({0}!={1})",
    ca.OP_NOT: "(!({0}!=0))",
    ca.OP_AND: "({0}!=0&&{1}!=0)",
    ca.OP_OR: "({0}!=0||{1}!=0)",
    ca.OP_IF_ELSE_ZERO: "({0}!=0?{1}:0)",
    ca.OP_SIGN: "({0}<0?-1:{0}>0?1:{0})",
}
"""Operations with operators in C; small integers are exact in both precisions."""

FUNCTIONS_OF_ONE = {
    ca.OP_EXP: "exp",
    ca.OP_EXPM1: "expm1",
    ca.OP_LOG: "log",
    ca.OP_LOG1P: "log1p",
    ca.OP_SQRT: "sqrt",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh",
    ca.OP_ERF: "erf",
    ca.OP_ERFINV: "erf_inverse",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_FABS: "fabs",
}
FUNCTIONS_OF_TWO = {
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_HYPOT: "hypot",
    ca.OP_ATAN2: "atan2",
    ca.OP_COPYSIGN: "copysign",
    ca.OP_FMOD: "fmod",
    ca.OP_REMAINDER: "remainder",
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
}
"""Operations with functions in math.h, except `ERF_INVERSE`."""

COMPARISONS = {ca.OP_FMIN: "({0}<{1}?{0}:{1})", ca.OP_FMAX: "({0}>{1}?{0}:{1})"}
"""Minimum and maximum without a call."""

INLINED = ("exp", "log", "pow", "sin", "cos", "tanh")
"""Functions of `elementary.h`; all others call math.h in every lane."""

ERF_INVERSE = Template("""\
/* The inverse of erf: an estimate by Winitzki, then Halley's method, on erfc where erf has few digits left. */
static inline $real erf_inverse$f($real x) {
  const $real size = fabs$f(x), rest = 1 - size;
  if (!(rest > 0)) return x / sqrt$f(rest);
  const $real half_log = log$f(rest * (1 + size)) / 2, t = 4.3307467$f + half_log;
  $real y = rest > 0.5$f ? size : sqrt$f(sqrt$f(t * t - 13.605442$f * half_log) - t);
  for (int k = 0; k < 4; ++k) {
    const $real miss = rest > 0.5$f ? erf$f(y) - size : rest - erfc$f(y);
    const $real newton = miss * 0.88622692545275801$f * exp$f(y * y);
    y -= newton / (1 + y * newton);
  }
  return copysign$f(y, x);
}
""")
"""A function that math.h lacks."""


@dataclass(frozen=True)
class Style:
    """Style of operations in C; subclasses write other languages.

    Attributes:
        precision: precision of all numbers and operations.
        compares: minimum and maximum by a comparison instead of a call; it gives the second operand where one is NaN,
            the functions of C give the other one.
        inlined: whether elementary functions are those of `elementary.h`, if available.
        generator: generator of the C.
    """

    precision: Precision = "double"
    compares: bool = False
    inlined: bool = False
    generator: Generator = "dualwinch"

    def number(self, value: float) -> str:
        """A constant."""
        return literal(value, self.precision)

    def copy(self, target: str, value: str) -> str:
        """The assignment of a value to a variable."""
        return f"{target}={value};"

    def operation(self, target: str, operation: int, operands: Sequence[str]) -> str:
        """The assignment of the result of an operation to a variable."""
        return self.copy(target, patterns(self)[operation].format(*operands))

    def declared(self, statement: str, *, constant: bool = False) -> str:
        """The first statement of a local variable of a loop, with its declaration."""
        return f"{'const ' * constant}{self.precision} {statement}"

    def declarations(self, names: Sequence[str]) -> list[str]:
        """Declarations of work variables, before all statements."""
        if not names:
            return []
        return textwrap.wrap(
            f"{self.precision} {', '.join(names)};", 118, initial_indent="  ", subsequent_indent="      "
        )

    def loop(self, rounds: int, before: Sequence[str], body: Sequence[str], after: Sequence[str]) -> list[str]:
        """A loop with local variables: declarations, a round, and statements after the loop."""
        head = ["  {", "    int turn;", *before, f"    for (turn=0;turn<{rounds};++turn) {{"]
        return [*head, *body, "    }", *after, "  }"]


@cache
def patterns(style: Style) -> dict[int, str]:
    """Operation → its C, with ``{0}`` and ``{1}`` for its operands.

    It has every operation of SX expressions except ``OP_PRINTME`` and ``OP_CALL``, the call of another function.
    """

    def called(name: str) -> str:
        return f"inline_{name}" if style.inlined and name in INLINED else name + suffix(style.precision)

    written = OPERATORS | {operation: f"{called(name)}({{0}})" for operation, name in FUNCTIONS_OF_ONE.items()}
    written |= {operation: f"{called(name)}({{0}},{{1}})" for operation, name in FUNCTIONS_OF_TWO.items()}
    return written | (COMPARISONS if style.compares else {})


def name_of(operation: int) -> str:
    """CasADi's name of an operation, in lower case and without ``OP_``."""
    names = (name for name in dir(ca) if name.startswith("OP_") and getattr(ca, name) == operation)
    return next(names, f"operation {operation}").removeprefix("OP_").lower()
