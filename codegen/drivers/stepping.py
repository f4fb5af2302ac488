"""Runs of a sampled system side by side, moved on a few samples a call under commands from outside."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import casadi as ca

from dualwinch.codegen.cache import library
from dualwinch.codegen.compiler import SCHEDULED, Compiler, find_compiler
from dualwinch.codegen.drivers.unit import hoisted_all, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.instructions import elements_read
from dualwinch.codegen.source.lanes import LANES, Lanes, lane_flags, lane_sizes

DRIVER = ("sampled_lanes.h", "stepping.c")


@dataclass(frozen=True)
class Commanded:
    """A sampled system under commands from outside.

    Attributes:
        system: what is moved on.
        sense: ``sense(state, exogenous, parameters) -> observation``: what is observed ahead of a command.
        commands: of each command the indices of the states that it is put into.
    """

    system: Sampled
    sense: ca.Function
    commands: tuple[tuple[int, ...], ...]


def stepping_source(commanded: Commanded, compiler: Compiler, *, exact: bool) -> str:
    """C99 translation unit that moves runs on; `exact`: one by one, with the operations of a single rollout."""
    functions = hoisted_all((*commanded.system.functions, commanded.sense))
    read = sorted(set().union(*(elements_read(function, "exogenous") for function in functions))) or [0]
    pairs = [(of, state) for of, states in enumerate(commanded.commands) for state in states]
    listed = "".join(
        f"#define {name} {{{', '.join(map(str, numbers))}}}\n"
        for name, numbers in (
            ("READ_EXOGENOUS", read),
            ("COMMAND_OF", [of for of, _ in pairs]),
            ("COMMANDED_STATES", [state for _, state in pairs]),
        )
    )
    sizes = commanded.system.sizes | {
        "OBSERVED": commanded.sense.numel_out("observation"),
        "COMMANDS": len(commanded.commands),
    }
    if exact:
        sizes |= {"LANES": 1, "PAIRED": 0}
        return unit(sizes, functions, "lanes.h", c_source(functions), listed, *DRIVER)
    lanes = {function.name(): Lanes(paired=not compiler.is_clang, shared=("part",)) for function in functions}
    source = c_source(functions, lanes=lanes)
    return unit(sizes | lane_sizes(compiler), functions, "elementary.h", "lanes.h", source, listed, *DRIVER)


class Pointers(ctypes.Structure):
    """`Runs` of stepping.c."""

    _fields_ = (
        ("constants", ctypes.c_void_p),
        ("apart", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("lines", "state", "outcome", "done", "commands", "observation")),
        ("runs", ctypes.c_int64),
        ("samples", ctypes.c_int64),
    )


@dataclass(frozen=True)
class Stepping:
    """The compiled code.

    Attributes:
        lanes: runs in a block.
        constants: numbers that a block takes of its parameters.
        states, parameters, exogenous, columns, observed, commands: sizes of the vectors.
        prepare, look, odd_command, step: functions of stepping.c.
    """

    lanes: int
    constants: int
    states: int
    parameters: int
    exogenous: int
    columns: int
    observed: int
    commands: int
    prepare: Callable[..., None]
    look: Callable[..., None]
    odd_command: Callable[..., int]
    step: Callable[..., int]


@cache
def compile_stepping(commanded: Commanded, *, exact: bool, compiler: Compiler | None = None) -> Stepping:
    """Compile (or find in the cache) and load what moves runs on; see `compile_rollout`.

    Args:
        commanded: what is moved on.
        exact: with the operations of a single rollout, one run after the other; else `LANES` runs side by side, whose
            elementary functions err by up to 1e-9 of their value.
        compiler: by default the one `find_compiler` finds.
    """
    chosen = compiler or find_compiler()
    flags = lane_flags(chosen) if not exact else () if chosen.is_clang else SCHEDULED
    loaded = ctypes.CDLL(str(library(stepping_source(commanded, chosen, exact=exact), chosen, flags)))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    for name, arguments in {
        "prepare": [pointer, pointer],
        "look": [pointer, count, count],
        "odd_command": [pointer],
        "step": [pointer, count, count, count, pointer],
    }.items():
        getattr(loaded, name).argtypes = arguments
        getattr(loaded, name).restype = count if name in {"odd_command", "step"} else None
    sizes = commanded.system.sizes
    return Stepping(
        lanes=1 if exact else LANES,
        constants=ctypes.c_int64.in_dll(loaded, "constants_size").value,
        states=sizes["STATES"],
        parameters=sizes["PARAMETERS"],
        exogenous=sizes["EXOGENOUS"],
        columns=sizes["COLUMNS"],
        observed=commanded.sense.numel_out("observation"),
        commands=len(commanded.commands),
        prepare=loaded.prepare,
        look=loaded.look,
        odd_command=loaded.odd_command,
        step=loaded.step,
    )
