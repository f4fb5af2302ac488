"""C source of CasADi functions, over arrays that have the names of the functions' own arguments."""

from collections.abc import Mapping, Sequence

import casadi as ca

from dualwinch.codegen.source.instructions import elements_read
from dualwinch.codegen.source.lanes import Lanes
from dualwinch.codegen.source.operations import Style
from dualwinch.codegen.source.rolled import rolled_statements
from dualwinch.codegen.source.statements import Strand, helpers, statements


def c_source(
    functions: Sequence[ca.Function], style: Style | None = None, lanes: Mapping[str, Lanes] | None = None
) -> str:
    """C99 definitions ``static inline void NAME(const double *IN, ..., double *OUT, ...)``, one a function.

    Inputs and outputs are dense vectors and must not overlap. Out of lanes, a null output is not written.

    Args:
        functions: named functions of SX expressions with named inputs and outputs.
        style: how operations are written.
        lanes: name → how the arrays lie of a function that is called in vector lanes; the others' are plain.

    Raises:
        CodegenError: a function holds something that is no plain C.
    """
    style, lanes = style or Style(), lanes or {}
    definitions = [_definition(function, style, lanes.get(function.name())) for function in functions]
    helping = helpers(functions, style.precision)
    return "\n\n".join(["#include <math.h>", *([helping] if helping else []), *definitions]) + "\n"


def _definition(function: ca.Function, style: Style, lanes: Lanes | None) -> str:
    inputs, outputs, real = function.name_in(), function.name_out(), style.precision
    arguments = ",\n    ".join(
        [f"const {real} *restrict {name}" for name in inputs] + [f"{real} *restrict {name}" for name in outputs]
    )
    unused = [name for name in inputs if not elements_read(function, name)]
    unused += [name for name in outputs if not function.numel_out(name)]
    strands = lanes.strands if lanes else (Strand(optional=True),)
    once = inputs == ["parameters"]  # a run: room counts there, time does not
    lines = (rolled_statements if once else statements)(function, lanes.style if lanes else style, strands)
    lines += [f"  (void){name};" for name in unused]
    attribute = "__attribute__((always_inline)) " if lanes else ""
    return "\n".join([f"static inline {attribute}void {function.name()}(\n    {arguments}) {{", *lines, "}"])
