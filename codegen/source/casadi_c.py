"""C of CasADi's own code generator, unchanged, and the statements that call it."""

import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import casadi as ca

from dualwinch.codegen.errors import CodegenError, CodegenWarning
from dualwinch.codegen.source.expressions import GRAPHS, as_written, elements_read
from dualwinch.codegen.source.operations import Style, name_of, patterns

IGNORED = ("-Wunused-parameter", "-Wunused-function", "-Wunused-variable", "-Wconversion", "-Wshadow")
"""Compiler warnings that CasADi's text causes."""

BEFORE = "\n".join(
    [
        "#define CASADI_SYMBOL_EXPORT static inline /* of this translation unit alone */",
        "#if defined(__GNUC__)",
        "#pragma GCC diagnostic push",
        *(f'#pragma GCC diagnostic ignored "{warning}"' for warning in IGNORED),
        "#endif\n",
    ]
)
AFTER = "#if defined(__GNUC__)\n#pragma GCC diagnostic pop\n#endif\n"
"""Text before and after CasADi's unchanged text."""


@GRAPHS.cached
def lacking(function: ca.Function) -> str | None:
    """Reason why the emitter has no C for a function; None where it has C for all operations."""
    if not function.is_a("SXFunction"):
        return f"it is no function of SX expressions but of class {function.class_name()}"
    operations = {*patterns(Style()), ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    unknown = sorted({function.instruction_id(index) for index in range(function.n_instructions())} - operations)
    return f"there is none for its '{name_of(unknown[0])}'" if unknown else None


def by_casadi(function: ca.Function, style: Style) -> bool:
    """Whether a function's C is CasADi's: by the style, or because the emitter has none."""
    return bool(function.nnz_out()) and (style.generator == "casadi" or lacking(function) is not None)


def casadi_text(functions: Iterable[ca.Function], style: Style) -> str:
    """CasADi's C of the functions that need it, in one text; empty without any.

    A `CodegenWarning` names the functions for which the emitter has no C.

    Raises:
        CodegenError: CasADi generates no C either, or the style is single precision, which its C does not support.
    """
    written = [function for function in functions if by_casadi(function, style)]
    if not written:
        return ""
    for function in written:
        reason = lacking(function)
        if style.precision != "double":
            raise CodegenError(f"no C in single precision for {function.name()}: {reason or 'CasADi writes double'}")
        if reason and style.generator != "casadi":
            message = f"no C of our own for {function.name()}: {reason}; CasADi's is used, without vector lanes"
            warnings.warn(message, CodegenWarning, stacklevel=4)
    generator = ca.CodeGenerator("generated.c")
    for function in written:
        generator.add(renamed(function, f"generated_{function.name()}"))
    text = generator.dump()
    check_generated(text, ", ".join(function.name() for function in written))
    return BEFORE + text + AFTER


def check_generated(text: str, name: str) -> None:
    """Check that CasADi's text is complete.

    Raises:
        CodegenError: CasADi has no C for a part of it.
    """
    if refused := re.search(r"#error (.*)", text):
        raise CodegenError(f"no C for {name}: {refused[1]}")


def calling_statements(
    function: ca.Function, elements: Sequence[Callable[[str, int], str]], *, optional: bool
) -> list[str]:
    """Statements that call CasADi's C of a function, defined before; where it fails, results are NaN.

    Args:
        function: function with dense arguments and results.
        elements: for each evaluation, ``(argument or result, element) -> C``.
        optional: whether result arrays may be null, and are not written then.
    """
    generated = renamed(function, f"generated_{function.name()}")
    ins = [(name, generated.numel_in(name)) for name in generated.name_in()]
    outs = [(name, generated.numel_out(name)) for name in generated.name_out()]
    lines = []
    for element in elements:
        lines += ["  {"]
        lines += [f"    double {name}_[{max(count, 1)}] = {{0}};" for name, count in (*ins, *outs)]
        lines += [f"    const double *call_arg[{generated.sz_arg()}] = {{{', '.join(f'{name}_' for name, _ in ins)}}};"]
        lines += [f"    double *call_res[{generated.sz_res()}] = {{{', '.join(f'{name}_' for name, _ in outs)}}};"]
        lines += [f"    casadi_int call_iw[{generated.sz_iw() + 1}];", f"    double call_w[{generated.sz_w() + 1}];"]
        lines += [f"    const int memory = {generated.name()}_checkout();"]
        lines += [
            f"    {name}_[{k}]={element(name, k)};" for name, _ in ins for k in sorted(elements_read(generated, name))
        ]
        lines += [f"    const int failed = {generated.name()}(call_arg, call_res, call_iw, call_w, memory);"]
        lines += [f"    {generated.name()}_release(memory);"]
        for name, count in outs:
            condition = f"if ({name}) " if optional else ""
            lines += [f"    {condition}{element(name, k)}=failed ? NAN : {name}_[{k}];" for k in range(count)]
        lines += ["  }"]
    return lines


@GRAPHS.cached
def renamed(function: ca.Function, name: str) -> ca.Function:
    """The function under another name, with the same operations."""
    inputs: Any = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    names = function.name_in(), function.name_out()
    with as_written():
        return ca.Function(name, inputs, function.call(inputs), *names)
