"""C source of CasADi functions, with the functions' own names for their arguments."""

import re

import casadi as ca

from dualwinch.codegen.errors import CodegenError

HELPER = re.compile(r"^static inline casadi_real casadi_\w+\([^)]*\) \{(?:[^\n]*|\n.*?^)\}$", re.MULTILINE | re.DOTALL)
"""A helper that CasADi writes beside the functions, such as ``casadi_fmin``."""

BODY = re.compile(
    r"^static int casadi_f\d+\(const casadi_real\*\* arg[^)]*\) \{\n(.*?)^  return 0;\n\}$",
    re.MULTILINE | re.DOTALL,
)
"""The statements of one generated function, in the order the functions were added."""


def c_source(functions: list[ca.Function]) -> str:
    """C99 definitions ``static inline void NAME(const double *IN, ..., double *OUT, ...)``, one a function.

    Inputs and outputs are dense vectors and must not overlap. A null output is not written.

    Args:
        functions: named functions of SX expressions with named inputs and outputs.

    Raises:
        CodegenError: a function holds something that CasADi cannot express as plain C statements.
    """
    source, bodies = generated(functions)
    helpers = HELPER.findall(source)
    definitions = [_definition(function, body) for function, body in zip(functions, bodies, strict=True)]
    text = "\n\n".join(["#include <math.h>", *helpers, *definitions]) + "\n"
    return text.replace("casadi_real", "double")


def generated(functions: list[ca.Function]) -> tuple[str, list[str]]:
    """The C text CasADi writes for functions, and the statements of each with ``NAME[i]`` for their arguments.

    Raises:
        CodegenError: as for `c_source`.
    """
    generator = ca.CodeGenerator("unit.c", {"static_aux": True, "inline_aux": True})
    for function in functions:
        if not function.is_a("SXFunction"):
            raise CodegenError(f"{function.name()} is no function of SX expressions; expand() it first")
        generator.add(function)
    source = generator.dump()
    bodies = BODY.findall(source)
    if len(bodies) != len(functions):
        raise CodegenError(f"no plain C for {', '.join(function.name() for function in functions)}")
    return source, [_named(function, body) for function, body in zip(functions, bodies, strict=True)]


def _named(function: ca.Function, body: str) -> str:
    for place, name in enumerate(function.name_in()):
        body = re.sub(rf"arg\[{place}\]\? arg\[{place}\]\[(\d+)\] : 0;", rf"{name}[\1];", body)
    for place, name in enumerate(function.name_out()):
        body = re.sub(rf"if \(res\[{place}\]!=0\) res\[{place}\]\[", f"if ({name}) {name}[", body)
    leftover = re.search(r"\b(?:arg|res|iw|w)\[|casadi_(?:f\d|int)|#error", body)
    if leftover:
        raise CodegenError(f"no plain C for {function.name()}: {leftover.group(0)}")
    return body


def _definition(function: ca.Function, body: str) -> str:
    inputs, outputs = function.name_in(), function.name_out()
    arguments = ",\n    ".join(
        [f"const double *restrict {name}" for name in inputs] + [f"double *restrict {name}" for name in outputs]
    )
    unused = "".join(f"  (void){name};\n" for name in (*inputs, *outputs) if not re.search(rf"\b{name}\[", body))
    return f"static inline void {function.name()}(\n    {arguments}) {{\n{body}{unused}}}"
