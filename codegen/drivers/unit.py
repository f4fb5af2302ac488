"""Puts one C translation unit together: sizes as macros, generated functions, a driver."""

from collections.abc import Iterable, Mapping
from importlib.resources import files

import casadi as ca

from dualwinch.codegen.source.expressions import elements_read
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


def all_read(functions: Iterable[ca.Function], name: str) -> list[int]:
    """The elements of an input that some functions read; at least one, as C has no empty arrays."""
    return sorted(set().union(*(elements_read(function, name) for function in functions))) or [0]


def macros_of_lists(**lists: Iterable[object]) -> str:
    """C macros of lists in braces."""
    return "".join(f"#define {name} {{{', '.join(map(str, values))}}}\n" for name, values in lists.items())


def kept_rows(samples: int, stride: int) -> int:
    """How many rows of a run are kept where every `stride`-th sample keeps one, the first included; 0: none."""
    return -(-samples // stride) if stride else 0
