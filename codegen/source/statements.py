"""C statements of a function of SX expressions: one for each of its instructions, in their order."""

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.casadi_c import by_casadi, calling_statements, casadi_text
from dualwinch.codegen.source.expressions import instructions
from dualwinch.codegen.source.operations import ERF_INVERSE, Precision, Style, literal, patterns, suffix

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


def statements(function: ca.Function, style: Style | None = None, strands: Sequence[Strand] = (Strand(),)) -> list[str]:
    """Declarations and statements that evaluate a function: a line an instruction, with CasADi's work variables.

    Where the emitter has no C for one of its operations, they call CasADi's C of the function, which is of `helpers`.

    Args:
        function: with dense arguments and results.
        style: how operations are written.
        strands: evaluations side by side; each statement stands there for one after the other.

    Raises:
        CodegenError: an argument or a result is sparse.
    """
    style = style or Style()
    _check_dense(function)
    if by_casadi(function, style):
        return calling_statements(function, [strand.element for strand in strands], optional=strands[0].optional)
    pattern, names_in, names_out = patterns(style), function.name_in(), function.name_out()
    lines = [line for strand in strands for line in _declarations(style.precision, strand.register, function.sz_w())]
    for operation, read, written, constant in instructions(function):
        for strand in strands:
            register = strand.register
            if operation == ca.OP_OUTPUT:
                name = names_out[written[0]]
                target, value = strand.element(name, written[1]), f"{register}{read[0]}"
                target = f"if ({name}) {target}" if strand.optional else target
            elif operation == ca.OP_INPUT:
                target, value = f"{register}{written[0]}", strand.element(names_in[read[0]], read[1])
            elif operation == ca.OP_CONST:
                target, value = f"{register}{written[0]}", literal(constant, style.precision)
            else:
                operands = [f"{register}{number}" for number in read]
                target, value = f"{register}{written[0]}", pattern[operation].format(*operands)
            lines.append(f"  {target}={value};")
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


def _declarations(precision: Precision, register: str, count: int) -> list[str]:
    if not count:
        return []
    names = ", ".join(f"{register}{number}" for number in range(count))
    return textwrap.wrap(f"{precision} {names};", 118, initial_indent="  ", subsequent_indent="      ")


def _check_dense(function: ca.Function) -> None:
    sides = (
        (function.name_in(), function.sparsity_in),
        (function.name_out(), function.sparsity_out),
    )
    for names, sparsity in sides:
        for index, name in enumerate(names):
            if not sparsity(index).is_dense():
                raise CodegenError(f"no plain C for {function.name()}: {name} is sparse; densify() it first")
