"""C statements of a function of SX expressions: one for each of its instructions, in their order."""

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.expressions import instructions
from dualwinch.codegen.source.operations import ERF_INVERSE, Precision, Style, literal, name_of, patterns, suffix

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

    Args:
        function: of SX expressions, with dense arguments and results.
        style: how operations are written.
        strands: evaluations side by side; each statement stands there for one after the other.

    Raises:
        CodegenError: the function holds something that is no plain C.
    """
    style = style or Style()
    _check_dense(function)
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
            elif operation in pattern:
                operands = [f"{register}{number}" for number in read]
                target, value = f"{register}{written[0]}", pattern[operation].format(*operands)
            else:
                raise CodegenError(f"no plain C for {function.name()}: there is none for its '{name_of(operation)}'")
            lines.append(f"  {target}={value};")
    return lines


def helpers(functions: Iterable[ca.Function], precision: Precision) -> str:
    """C functions that the statements of some functions call and math.h lacks."""
    operations = {made.operation for function in functions for made in instructions(function)}
    if ca.OP_ERFINV not in operations:
        return ""
    return ERF_INVERSE.substitute(real=precision, f=suffix(precision))


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
