"""Numbers and operations in Structured Text (IEC 61131-3), statement by statement as in C."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from dualwinch.toolbox import errors, language

TYPES: dict[language.Precision, str] = {"double": "LREAL", "float": "REAL"}

WHOLE: dict[language.Precision, float] = {"double": 2.0**52, "float": 2.0**23}
"""Limit above which all numbers are whole; adding it rounds to a whole number."""

WORK = "work"
"""Prefix of work variables."""

EXPRESSIONS = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_INV: "{one} / {0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{two} * {0}",
    ca.OP_FABS: "ABS({0})",
    ca.OP_SQRT: "SQRT({0})",
    ca.OP_EXP: "EXP({0})",
    ca.OP_LOG: "LN({0})",
    ca.OP_SIN: "SIN({0})",
    ca.OP_COS: "COS({0})",
    ca.OP_TAN: "TAN({0})",
    ca.OP_ASIN: "ASIN({0})",
    ca.OP_ACOS: "ACOS({0})",
    ca.OP_ATAN: "ATAN({0})",
    ca.OP_FLOOR: "{functions}_floor(value := {0})",
    ca.OP_CEIL: "-{functions}_floor(value := -{0})",
}
"""Operations that are expressions."""

CONDITIONS = {
    ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}",
    ca.OP_EQ: "{0} = {1}",
    ca.OP_NE: "{0} <> {1}",
    ca.OP_NOT: "{0} = {zero}",
    ca.OP_AND: "({0} <> {zero}) AND ({1} <> {zero})",
    ca.OP_OR: "({0} <> {zero}) OR ({1} <> {zero})",
}
"""Operations that are 1 where a condition holds, else 0; the conversion of BOOL to a number depends on the vendor."""

CHOICES = {
    ca.OP_IF_ELSE_ZERO: (("{0} <> {zero}", "{1}"), ("", "{zero}")),
    ca.OP_FMIN: (("{0} < {1}", "{0}"), ("", "{1}")),
    ca.OP_FMAX: (("{0} > {1}", "{0}"), ("", "{1}")),
    ca.OP_SIGN: (("{0} < {zero}", "{minus}"), ("{0} > {zero}", "{one}"), ("", "{0}")),
    ca.OP_COPYSIGN: (("{1} < {zero}", "-ABS({0})"), ("", "ABS({0})")),
}
"""Operations that are the first value with a true condition.

MIN and MAX of NaN differ between controllers; copysign treats −0 as 0.
"""


@dataclass(frozen=True)
class StructuredText(language.Style):
    """Structured Text with one statement per operation.

    Attributes:
        functions: prefix of the name of `floor_function`.
    """

    functions: str = ""

    @property
    def real(self) -> str:
        """The type of numbers."""
        return TYPES[self.precision]

    def number(self, value: float) -> str:
        """A constant with its type, which otherwise depends on the compiler.

        Raises:
            CodegenError: the number is not finite.
        """
        if not math.isfinite(value):
            raise errors.CodegenError(f"no Structured Text for the constant {value}: must be finite")
        digits, exponent, power = language.literal(value, self.precision).removesuffix("f").partition("e")
        digits = digits if "." in digits else f"{digits}.0"
        return f"{self.real}#{digits}{f'E{int(power)}' if exponent else ''}"

    def copy(self, target: str, value: str) -> str:
        """The assignment of a value to a variable."""
        return f"{target} := {value};"

    def operation(self, target: str, operation: int, operands: Sequence[str]) -> str:
        """The assignment of the result of an operation to a variable.

        Raises:
            CodegenError: Structured Text has no such operation.
        """
        words = {"zero": self.number(0), "one": self.number(1), "two": self.number(2)}
        words |= {"minus": self.number(-1), "functions": self.functions}

        def written(pattern: str) -> str:
            return pattern.format(*operands, **words)

        if operation in EXPRESSIONS:
            return self.copy(target, written(EXPRESSIONS[operation]))
        if operation in CONDITIONS:
            choices = ((CONDITIONS[operation], "{one}"), ("", "{zero}"))
        elif operation in CHOICES:
            choices = CHOICES[operation]
        else:
            raise errors.CodegenError(f"no Structured Text for '{language.name_of(operation)}'")
        parts = [
            f"{('ELSIF' if number else 'IF') + ' ' + written(condition) + ' THEN' if condition else 'ELSE'} "
            f"{self.copy(target, written(value))}"
            for number, (condition, value) in enumerate(choices)
        ]
        return f"{' '.join(parts)} END_IF;"

    def is_finite(self, name: str) -> str:
        """The condition that a variable is finite, without a large constant, which matiec rejects."""
        return f"({name} - {name} = {self.number(0)})"

    def declared(self, statement: str, *, constant: bool = False) -> str:  # noqa: ARG002
        """The first statement of a variable of a loop; variables are declared before all statements."""
        return statement

    def declarations(self, names: Sequence[str]) -> list[str]:  # noqa: ARG002
        """None: `work_variables` are declared before all statements."""
        return []

    def loop(self, rounds: int, before: Sequence[str], body: Sequence[str], after: Sequence[str]) -> list[str]:
        """A loop of a known number of rounds."""
        return [*before, f"    FOR turn := 0 TO {rounds - 1} DO", *body, "    END_FOR;", *after]


def work_variables(statements: Sequence[str]) -> list[str]:
    """The work variables of some statements, by their numbers."""
    names = {name for line in statements for name in re.findall(rf"(?<![\w.]){WORK}[\d_]+\b", line)}
    return sorted(names, key=lambda name: [int(number) for number in re.findall(r"\d+", name)])


def floor_function(style: StructuredText) -> tuple[str, list[str]]:
    """The statements of an exact function ``floor`` of ``value``, with the local variable ``whole``.

    Returns:
        Its name, and the statements.
    """
    name, limit = f"{style.functions}_floor", style.number(WHOLE[style.precision])
    return name, [
        "whole := value;",
        f"IF ABS(value) < {limit} THEN",
        f"  whole := (ABS(value) + {limit}) - {limit};",
        f"  IF value < {style.number(0)} THEN whole := -whole; END_IF;",
        f"  IF whole > value THEN whole := whole - {style.number(1)}; END_IF;",
        "END_IF;",
        f"{name} := whole;",
    ]
