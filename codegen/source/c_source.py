"""C source of CasADi functions over arrays named as their arguments, scalar or in vector lanes."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca

from dualwinch.codegen.compiler import SCHEDULED, Compiler
from dualwinch.codegen.source.casadi_c import by_casadi
from dualwinch.codegen.source.expressions import elements_read, instructions
from dualwinch.codegen.source.loops import rolled_statements
from dualwinch.codegen.source.operations import Style
from dualwinch.codegen.source.statements import Strand, helpers, statements

LANES = 16
"""Parallel computations: two AVX-512 vectors of doubles, four of AVX2, eight of SSE2 or NEON."""

LANE_FLAGS = ("-ffp-contract=fast", "-freciprocal-math", "-mprefer-vector-width=512", "-fno-finite-math-only")
"""Additional flags. Contraction and reciprocals change the last bits, in the same way in every lane.

Non-finite numbers must be respected: gcc turns choices into branches and back into masks, and if it takes `x > 0` for
the opposite of `x <= 0`, a NaN in one of two interleaved lanes spoils the result of the other.
"""

GCC_FLAGS = (*SCHEDULED, "-fno-thread-jumps", "--param=loop-max-datarefs-for-datadeps=100000")
"""Additional flags of gcc: scheduling limited by register pressure, and no jump threading.

By default it turns choices into branches, threads these, and turns the result into several masks each; and it does not
vectorise loops with more than a thousand reads and writes, such as that of a machine with heavy ropes.
"""


PART = 250
"""Statements per C function. Divided like this, gcc compiles 30 000 statements in a third of the time, and they run a
tenth longer."""


def lane_flags(compiler: Compiler) -> tuple[str, ...]:
    """Additional flags of a build with lanes."""
    return LANE_FLAGS if compiler.is_clang else LANE_FLAGS + GCC_FLAGS


PAIRED_STATEMENTS = 2000
"""Longest function that processes two lanes per call. Twice the statements of a longer one are more than a core's cache
of decoded instructions holds: they run no faster, and take twice the time to compile."""


def paired(functions: Sequence[ca.Function], compiler: Compiler) -> bool:
    """Whether functions in lanes process two lanes per call; those of the parameters alone never do."""
    lengths = (function.n_instructions() for function in functions if not _runs_once(function))
    return compiler.pairs and max(lengths) <= PAIRED_STATEMENTS


def _runs_once(function: ca.Function) -> bool:
    return function.name_in() == ["parameters"]


def lane_sizes(*, paired: bool) -> dict[str, int]:
    """``LANES``, and ``PAIRED``: whether functions process two lanes per call."""
    return {"LANES": LANES, "PAIRED": int(paired)}


@dataclass(frozen=True)
class LaneLayout:
    """Layout of a function in lanes: arrays have the `stride`, and functions of `elementary.h` are inlined.

    A function of the parameters alone is called for one lane at a time, and not inlined.

    Attributes:
        paired: whether a call processes a lane and the one lanes/2 further on, statement by statement, to hide the
            latency of instructions.
        shared: arguments that are the same in all lanes.
        stride: the number of lanes as C text.
        packed: input → the elements in its array, in order; other arrays hold all elements.
    """

    paired: bool
    shared: Collection[str] = ()
    stride: str = "LANES"
    packed: Mapping[str, Sequence[int]] = field(default_factory=dict)

    style = Style(compares=True, inlined=True)
    """Style of operations."""

    @property
    def strands(self) -> tuple[Strand, ...]:
        """The evaluations of a call."""
        strand = Strand(self._element)
        return (strand, Strand(self._half_further, "b")) if self.paired else (strand,)

    def _element(self, name: str, element: int) -> str:
        position = self.packed[name].index(element) if name in self.packed else element
        return f"{name}[{position}]" if name in self.shared else f"{name}[{position}*{self.stride}]"

    def _half_further(self, name: str, element: int) -> str:
        here = self._element(name, element)
        return here if name in self.shared else f"{here[:-1]}+{self.stride}/2]"


def c_source(
    functions: Sequence[ca.Function],
    style: Style | None = None,
    lanes: Mapping[str, LaneLayout] | None = None,
    part: int | None = None,
) -> str:
    """C99 definitions ``static inline void NAME(const double *IN, ..., double *OUT, ...)``, one per function.

    Inputs and outputs are dense vectors and must not overlap. Without lanes, a null output is not written.

    Args:
        functions: named functions of SX expressions with named inputs and outputs.
        style: style of operations.
        lanes: name → layout of a function in vector lanes; other functions are scalar.
        part: largest number of statements of a function; a longer one is divided, and none of its outputs may be null.
            The time of register allocation grows faster than a function's length.

    Raises:
        CodegenError: an argument or a result is sparse, or a function has no C in single precision.
    """
    style, lanes = style or Style(), lanes or {}
    definitions = [
        _in_parts(function, style, part)
        if part and function.is_a("SXFunction") and function.n_instructions() > part and not by_casadi(function, style)
        else _definition(function, style, lanes.get(function.name()))
        for function in functions
    ]
    helping = helpers(functions, style)
    return "\n\n".join(["#include <math.h>", *([helping] if helping else []), *definitions]) + "\n"


def _arguments(function: ca.Function, style: Style) -> list[str]:
    """Declarations of a function's arguments."""
    real = style.precision
    inputs = [f"const {real} *restrict {name}" for name in function.name_in()]
    return inputs + [f"{real} *restrict {name}" for name in function.name_out()]


def _definition(function: ca.Function, style: Style, lanes: LaneLayout | None) -> str:
    inputs, outputs = function.name_in(), function.name_out()
    arguments = ",\n    ".join(_arguments(function, style))
    unused = [name for name in inputs if not elements_read(function, name)]
    unused += [name for name in outputs if not function.numel_out(name)]
    once = _runs_once(function)  # size matters, not speed
    strands = lanes.strands[: 1 if once else None] if lanes else (Strand(optional=True),)
    function_style = replace(lanes.style, generator=style.generator) if lanes else style
    lines = (rolled_statements if once else statements)(function, function_style, strands)
    lines += [f"  (void){name};" for name in unused]
    kind = "static inline"
    if lanes:
        kind = "static __attribute__((noinline))" if once else f"{kind} __attribute__((always_inline))"
    return "\n".join([f"{kind} void {function.name()}(\n    {arguments}) {{", *lines, "}"])


def _in_parts(function: ca.Function, style: Style, length: int) -> str:
    """A function that calls others in sequence, each with at most `length` of its statements.

    Values for later parts are passed in an array, ``kept``.
    """
    steps = [instruction[:3] for instruction in instructions(function)]
    lines = statements(function, style)[-len(steps) :]  # one per instruction, after the declarations
    bounds = range(0, len(steps), length)
    read, written = list[set[int]](), list[set[int]]()
    for start in bounds:
        needed, defined = set[int](), set[int]()
        for operation, operands, result in steps[start : start + length]:
            needed.update(() if operation == ca.OP_INPUT else set(operands) - defined)
            defined.update(() if operation == ca.OP_OUTPUT else result[:1])
        read.append(needed)
        written.append(defined)
    slots = {register: slot for slot, register in enumerate(sorted(set().union(*read)))}
    names, real = [*function.name_in(), *function.name_out()], style.precision
    arguments, parts, later = _arguments(function, style), list[str](), set[int]()
    for number in reversed(range(len(bounds))):
        surviving = sorted(written[number] & later)
        later = (later - written[number]) | read[number]
        body = [
            *style.declarations([f"a{register}" for register in sorted(read[number] | written[number])]),
            *(f"  {style.copy(f'a{register}', f'kept[{slots[register]}]')}" for register in sorted(read[number])),
            *lines[bounds[number] : bounds[number] + length],
            *(f"  {style.copy(f'kept[{slots[register]}]', f'a{register}')}" for register in surviving),
            *(f"  (void){name};" for name in [*names, "kept"]),
        ]
        head = ",\n    ".join([*arguments, f"{real} *restrict kept"])
        attributes = "static __attribute__((noinline)) void"
        parts.insert(0, f"{attributes} {function.name()}_{number}(\n    {head}) {{\n" + "\n".join(body) + "\n}")
    calls = [f"  {function.name()}_{number}({', '.join([*names, 'kept'])});" for number in range(len(bounds))]
    head = f"static inline void {function.name()}(\n    " + ",\n    ".join(arguments) + ") {"
    return "\n\n".join([*parts, "\n".join([head, f"  {real} kept[{len(slots) or 1}];", *calls, "}"])])
