"""Puts one C translation unit together: sizes as macros, generated functions, a driver."""

from collections.abc import Iterable, Mapping
from importlib.resources import files

import casadi as ca

from dualwinch.codegen.source.hoist import hoisted
from dualwinch.codegen.source.operations import Generator


def hoisted_all(functions: Iterable[ca.Function], generator: Generator = "dualwinch") -> list[ca.Function]:
    """``derive_NAME`` and the function that takes what it derives, for each (`codegen.source.hoist`)."""
    return [part for function in functions for part in hoisted(function, generator=generator)]


def unit(sizes: Mapping[str, int], functions: Iterable[ca.Function], *texts: str) -> str:
    """A translation unit.

    Args:
        sizes: macro name → value.
        functions: what `hoisted_all` gave; the size of what ``derive_NAME`` derives becomes ``NAME_DERIVED``.
        texts: C text, or names of C files beside this one, in their order; ``driver.h`` comes before them.
    """
    derived = {
        function.name().removeprefix("derive_").upper() + "_DERIVED": function.numel_out("derived")
        for function in functions
        if function.name().startswith("derive_")
    }
    lines = [f"#define {name} {size}" for name, size in (dict(sizes) | derived).items()]
    return "\n".join([*lines, *(_text(part) for part in ("driver.h", *texts))])


def _text(part: str) -> str:
    return c_file(part) if part.endswith((".c", ".h")) and "\n" not in part else part


def c_file(name: str) -> str:
    """The text of a C file beside this one."""
    return (files("dualwinch.codegen.drivers") / name).read_text(encoding="utf-8")
