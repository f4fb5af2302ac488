"""Turns generated C functions into ones that compilers carry out in vector lanes."""

import re
from collections.abc import Collection, Mapping

from dualwinch.codegen.compiler import SCHEDULED, Compiler

LANES = 16
"""Computations that run side by side: two AVX-512 vectors of doubles, four of AVX2, eight of SSE2 or NEON."""

FLAGS = ("-ffp-contract=fast", "-freciprocal-math", "-mprefer-vector-width=512", "-fno-finite-math-only")
"""Beside the flags of every build. Contraction and reciprocals change last bits, the same way in every lane.

Numbers that are not finite are reckoned with: gcc turns choices into branches and back into masks, and where it takes
`x > 0` for the opposite of `x <= 0`, a NaN in one of two interleaved lanes loses what the other one computed.
"""

GCC_FLAGS = (*SCHEDULED, "-fno-thread-jumps")
"""Flags that only gcc knows. It orders instructions with an eye to its registers, and leaves choices as they are.

Else it makes branches of choices, threads those through each other, and turns what comes of it into several masks each.
"""

DEFINITION = re.compile(r"^static inline (?:\S+ )?void (\w+)\(\n.*?^\}$", re.MULTILINE | re.DOTALL)
"""A generated function (`codegen.source.c_source`)."""

CALL = re.compile(r"(?<=[=(\-])(tanh|sin|cos|exp|log|pow)\(")
"""A call of an elementary function; `elementary.h` has one that runs in lanes."""

SMALLER_OR_LARGER = re.compile(r"(?<=return )(fmin|fmax)\(")
"""A call in CasADi's own helpers, which `elementary.h` makes none of."""

STATEMENT = re.compile(r"^  (double a\d|a\d+=|(if \(\w+\) )?\w+\[)|^      *a\d")
"""A line of a generated function that declares or computes something."""

OPTIONAL = re.compile(r"\bif \(\w+\) (?=\w+\[)")
"""What lets a generated function leave an output out."""


def lane_flags(compiler: Compiler) -> tuple[str, ...]:
    """Flags of a build with lanes, beside those of every build."""
    return FLAGS if compiler.is_clang else FLAGS + GCC_FLAGS


def lane_sizes(compiler: Compiler) -> dict[str, int]:
    """``LANES``, and ``PAIRED``: whether `in_lanes` interleaves the work of two vectors (clang does it by itself)."""
    return {"LANES": LANES, "PAIRED": int(not compiler.is_clang)}


def in_lanes(source: str, arrays: Mapping[str, Collection[str]], compiler: Compiler, *, lanes: str = "LANES") -> str:
    """The same functions over arrays whose elements lie `lanes` apart, without calls and without null outputs.

    Args:
        source: definitions by `codegen.source.c_source`.
        arrays: function name → names of those of its arguments that have a number for each lane. Functions not named
            here stay as they are.
        compiler: what it is for. For others than clang each statement stands twice, for a lane and for the one
            lanes/2 further on, so that a processor has something to do while it waits for a result.
        lanes: a number of lanes as C text.
    """

    def replaced(definition: re.Match[str]) -> str:
        name = definition.group(1)
        return (
            _in_lanes(definition.group(), arrays[name], lanes, not compiler.is_clang)
            if name in arrays
            else definition.group()
        )

    return DEFINITION.sub(replaced, SMALLER_OR_LARGER.sub(r"inline_\1(", source))


def _in_lanes(definition: str, arrays: Collection[str], lanes: str, paired: bool) -> str:
    element = re.compile(rf"\b({'|'.join(arrays)})\[(\d+)\]")
    lines: list[str] = []
    for line in CALL.sub(r"inline_\1(", definition).splitlines():
        if not STATEMENT.match(line):
            lines.append(line.replace("static inline void", "static inline __attribute__((always_inline)) void"))
            continue
        once = OPTIONAL.sub("", line)
        lines.append(element.sub(rf"\1[\2*{lanes}]", once))
        if paired:
            lines.append(re.sub(r"\ba(\d+)\b", r"b\1", element.sub(rf"\1[\2*{lanes}+{lanes}/2]", once)))
    return "\n".join(lines)
