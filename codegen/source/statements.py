"""Statements of a function of SX expressions: one for each of its instructions, in their order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.casadi_c import by_casadi, calling_statements, casadi_text
from dualwinch.codegen.source.expressions import instructions
from dualwinch.codegen.source.operations import ERF_INVERSE, Style, suffix

Element: TypeAlias = Callable[[str, int], str]
"""``(argument or result, element) -> C``: where an element stands."""


def of_array(name: str, element: int) -> str:
    """An element of an array that has the argument's name."""
    return f"{name}[{element}]"


@dataclass(frozen=True)
class Strand:
    """One of several evaluations whose statements are interleaved.

    Attributes:
        element: where the elements of its arguments and results stand.
        register: what the names of its work variables begin with.
        optional: whether results are arrays that may be null, and are not written then.
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
    """Declarations and statements that evaluate a function: a line an instruction, with CasADi's work variables.

    Where the emitter has no C for one of its operations, they call CasADi's C of the function, which is of `helpers`.

    Args:
        function: with dense arguments and results.
        style: how operations are written.
        strands: evaluations side by side; each statement stands there for one after the other.
        in_place: read arguments and constants where they are used, instead of into work variables before.

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
    held: list[dict[int, str]] = [{} for _ in strands]  # of each strand, register → what stands for it, in place
    for operation, read, written, constant in instructions(function):
        for strand, given in zip(strands, held, strict=True):
            target = f"{strand.register}{written[0]}"
            operands = [given.get(number, f"{strand.register}{number}") for number in read]
            if operation == ca.OP_OUTPUT:
                name = names_out[written[0]]
                target = f"if ({name}) " * strand.optional + strand.element(name, written[1])
                lines.append(f"  {style.copy(target, operands[0])}")
                continue
            given.pop(written[0], None)
            if operation not in {ca.OP_INPUT, ca.OP_CONST}:
                lines.append(f"  {style.operation(target, operation, operands)}")
                continue
            fixed = operation == ca.OP_CONST
            value = style.number(constant) if fixed else strand.element(names_in[read[0]], read[1])
            if in_place:
                given[written[0]] = value
            else:
                lines.append(f"  {style.copy(target, value)}")
    return lines


def helpers(functions: Sequence[ca.Function], style: Style) -> str:
    """C functions that the statements of some functions call and math.h lacks.

    Raises:
        CodegenError: there is no C of a function in single precision.
    """
    ours = [function for function in functions if not by_casadi(function, style)]
    operations = {made.operation for function in ours for made in instructions(function)}
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
