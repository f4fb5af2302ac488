"""Many rollouts at once in compiled C: one set of parameters in each vector lane."""

import ctypes
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from codegen.c_source import c_source
from codegen.cache import library
from codegen.compiler import Compiler, find_compiler
from codegen.hoist import hoisted
from codegen.rollout import sizes_of

LANES = 16
"""Rollouts that run side by side: two AVX-512 vectors of doubles, four of AVX2, eight of SSE2 or NEON."""

BATCH_FLAGS = ("-ffp-contract=fast", "-freciprocal-math", "-mprefer-vector-width=512")
"""Beside the flags of every build. Contraction and reciprocals change last bits, the same way in every lane."""

CALL = re.compile(r"(?<=[=(\-])(tanh|sin|exp|log|pow)\(")
"""A call of an elementary function; `elementary.h` has one that runs in lanes."""

Floats = NDArray[np.float64]


def _in_lanes(source: str, functions: tuple[ca.Function, ...]) -> str:
    """The functions of a C source over arrays whose elements lie LANES apart, without calls and null outputs."""
    for function in functions:
        for name in (*function.name_in(), *function.name_out()):
            source = re.sub(rf"\bif \({name}\) {name}\[", f"{name}[", source)
            source = re.sub(rf"\b{name}\[(\d+)\]", rf"{name}[\1*LANES]", source)
    source = source.replace("static inline void", "static inline __attribute__((always_inline)) void")
    return CALL.sub(r"inline_\1(", source)


def batch_source(step: ca.Function, shortcut: ca.Function | None = None) -> str:
    """C99 translation unit that runs a step for many samples in LANES lanes; arguments as for `rollout_source`."""
    functions = hoisted(step) + (hoisted(shortcut) if shortcut is not None else ())
    sizes = sizes_of(functions) | {"LANES": LANES}
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    elementary, driver = ((files("codegen") / name).read_text(encoding="utf-8") for name in ("elementary.h", "batch.c"))
    return "\n".join([*lines, elementary, _in_lanes(c_source(list(functions)), functions), driver])


@dataclass(frozen=True)
class Batch:
    """A compiled batch rollout of LANES sets of parameters at a time."""

    columns: int
    _call: "ctypes._NamedFuncPointer"

    def __call__(
        self, parameters: Floats, exogenous: list[Floats], state: Floats, stride: int = 0
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
        """Run one block; Python's lock is released meanwhile.

        Args:
            parameters: (LANES, parameters).
            exogenous: LANES tables (samples, exogenous), all of one length; the same table may come many times.
            state: (LANES, states); overwritten with the final states.
            stride: every how many samples a row is kept; 0 keeps none.

        Returns:
            Outcomes (LANES,), samples stepped (LANES,), rows (LANES, kept, columns), NaN after an early end.
        """
        samples = exogenous[0].shape[0]
        kept = -(-samples // stride) if stride else 0
        rows = np.full((LANES, kept, self.columns), np.nan)
        outcome, done = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
        tables = (ctypes.c_void_p * LANES)(*(table.ctypes.data for table in exogenous))
        self._call(
            parameters.ctypes.data,
            tables,
            state.ctypes.data,
            samples,
            max(stride, 1),
            rows.ctypes.data if stride else None,
            kept,
            outcome.ctypes.data,
            done.ctypes.data,
        )
        return outcome, done, rows


@cache
def compile_batch(step: ca.Function, shortcut: ca.Function | None = None, compiler: Compiler | None = None) -> Batch:
    """Compile (or find in the cache) and load the batch rollout of a step; arguments as for `compile_rollout`."""
    path = library(batch_source(step, shortcut), compiler or find_compiler(), BATCH_FLAGS)
    call = ctypes.CDLL(str(path)).batch
    call.restype = None
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    call.argtypes = [pointer, pointer, pointer, count, count, pointer, count, pointer, pointer]
    return Batch(step.numel_out("row"), call)
