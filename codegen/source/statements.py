"""Statements of a function of SX expressions: one for each of its instructions, in order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.casadi_c import by_casadi, calling_statements, casadi_text
from dualwinch.codegen.source.expressions import instructions
from dualwinch.codegen.source.operations import ERF_INVERSE, Style, suffix

Element: TypeAlias = Callable[[str, int], str]
"""``(argument or result, element) -> C``: C expression of an element."""


def of_array(name: str, element: int) -> str:
    """An element of an array with the argument's name."""
    return f"{name}[{element}]"


@dataclass(frozen=True)
class Strand:
    """One of several evaluations whose statements are interleaved.

    Attributes:
        element: C expressions of the elements of its arguments and results.
        register: prefix of its work variables.
        optional: whether result arrays may be null, and are not written then.
    """

    element: Element = of_array
    register: str = "a"
    optional: bool = False


def statements(
    function: ca.Function,
    style: Style | None = None,
    strands: Sequence[Strand] = (Strand(),),
    *,
    in_place: bool = False,
) -> list[str]:
    """Declarations and statements that evaluate a function: a line per instruction, with CasADi's work variables.

    If the emitter has no C for an operation, they call CasADi's C of the function, which is in `helpers`.

    Args:
        function: function with dense arguments and results.
        style: style of operations.
        strands: interleaved evaluations.
        in_place: use arguments and constants directly, without work variables.

    Raises:
        CodegenError: an argument or a result is sparse.
    """
    style = style or Style()
    _check_dense(function)
    if by_casadi(function, style):
        return calling_statements(function, [strand.element for strand in strands], optional=strands[0].optional)
    names_in, names_out = function.name_in(), function.name_out()
    count = range(function.sz_w())
    lines = [line for strand in strands for line in style.declarations([f"{strand.register}{k}" for k in count])]
    replaced: list[dict[int, str]] = [{} for _ in strands]  # for each strand, register → expression used in its place
    for operation, read, written, constant in instructions(function):
        for strand, expressions in zip(strands, replaced, strict=True):
            target = f"{strand.register}{written[0]}"
            operands = [expressions.get(number, f"{strand.register}{number}") for number in read]
            if operation == ca.OP_OUTPUT:
                name = names_out[written[0]]
                target = f"if ({name}) " * strand.optional + strand.element(name, written[1])
                lines.append(f"  {style.copy(target, operands[0])}")
                continue
            expressions.pop(written[0], None)
            if operation not in {ca.OP_INPUT, ca.OP_CONST}:
                lines.append(f"  {style.operation(target, operation, operands)}")
                continue
            fixed = operation == ca.OP_CONST
            value = style.number(constant) if fixed else strand.element(names_in[read[0]], read[1])
            if in_place:
                expressions[written[0]] = value
            else:
                lines.append(f"  {style.copy(target, value)}")
    return lines


def helpers(functions: Sequence[ca.Function], style: Style) -> str:
    """C functions that are called by the statements of the functions but missing in math.h.

    Raises:
        CodegenError: a function has no C in single precision.
    """
    emitted = [function for function in functions if not by_casadi(function, style)]
    operations = {instruction.operation for function in emitted for instruction in instructions(function)}
    real, f = style.precision, suffix(style.precision)
    inverse = ERF_INVERSE.substitute(real=real, f=f) if ca.OP_ERFINV in operations else ""
    return inverse + casadi_text(functions, style)


def _check_dense(function: ca.Function) -> None:
    sides = (
        (function.name_in(), function.sparsity_in),
        (function.name_out(), function.sparsity_out),
    )
    for names, sparsity in sides:
        for index, name in enumerate(names):
            if not sparsity(index).is_dense():
                raise CodegenError(f"no plain C for {function.name()}: {name} is sparse; densify() it first")
