"""Composition of a C translation unit: sizes as macros, generated functions, a driver."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

import casadi as ca

from dualwinch.codegen.compiler import fingerprint
from dualwinch.codegen.source.casadi_c import lacking
from dualwinch.codegen.source.expressions import BUILDING, elements_read
from dualwinch.codegen.source.hoist import hoisted_together
from dualwinch.codegen.source.operations import Generator


def hoisted_all(functions: Iterable[ca.Function], generator: Generator = "dualwinch") -> list[ca.Function]:
    """``derive``, and the functions that use its values (`hoisted_together`)."""
    derive, lean = hoisted_together(tuple(functions), generator=generator)
    return [derive, *lean]


def unit(sizes: Mapping[str, int], functions: Iterable[ca.Function], *texts: str) -> str:
    """A translation unit.

    Args:
        sizes: macro name → value.
        functions: result of `hoisted_all`; the number of values of ``derive`` becomes ``DERIVED``, that of
            ``derive_NAME`` ``NAME_DERIVED``.
        texts: C text, or names of C files in this folder, in order; ``driver.h`` comes before them.
    """
    derived = {
        "_".join([*function.name().upper().split("_")[1:], "DERIVED"]): function.numel_out("derived")
        for function in functions
        if function.name_out() == ["derived"]
    }
    lines = [f"#define {name} {size}" for name, size in (dict(sizes) | derived).items()]
    lines += [
        c_file(text) if text.endswith((".c", ".h")) and "\n" not in text else text for text in ("driver.h", *texts)
    ]
    return "\n".join(lines)


def c_file(name: str) -> str:
    """The text of a C file in this folder."""
    return (files("dualwinch.codegen.drivers") / name).read_text(encoding="utf-8")


def recipe(functions: Sequence[ca.Function], *options: object) -> str:
    """Fingerprint of everything that determines a translation unit (`cache.library`), much faster than writing it.

    Args:
        functions: its functions.
        options: further options besides the compiler; their `repr` must identify them.

    Returns:
        The fingerprint; empty where the emitter lacks an operation, so that each process warns of it.
    """
    with BUILDING:
        if any(map(lacking, functions)):
            return ""
        return fingerprint(_version(), *map(repr, options), *(function.serialize() for function in functions))


@cache
def _version() -> str:
    """Fingerprint of the code generator: the sources of `codegen`, and CasADi's version."""
    sources = (path for path in Path(__file__).parents[1].rglob("*") if path.suffix in {".py", ".c", ".h"})
    return fingerprint(ca.CasadiMeta.version(), *(path.read_text(encoding="utf-8") for path in sorted(sources)))


def all_read(functions: Iterable[ca.Function], name: str) -> list[int]:
    """The elements of an input that the functions read; at least one, as C has no empty arrays."""
    return sorted(set().union(*(elements_read(function, name) for function in functions))) or [0]


def macros_of_lists(**lists: Iterable[object]) -> str:
    """C macros of initialiser lists."""
    return "".join(f"#define {name} {{{', '.join(map(str, values))}}}\n" for name, values in lists.items())


def kept_rows(samples: int, stride: int) -> int:
    """Number of kept rows if every `stride`-th sample keeps one, from the first on; 0: none."""
    return -(-samples // stride) if stride else 0
