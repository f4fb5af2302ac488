"""A whole rollout in compiled C: the generated step and a driver loop in one translation unit."""

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from codegen.c_source import c_source
from codegen.cache import library
from codegen.compiler import Compiler, find_compiler
from codegen.hoist import hoisted

COMPLETED, DIVERGED, LEFT = 0, 1, 2
"""Outcomes of a rollout: ran to the end, a state is not finite, the margin went negative."""


def sizes_of(functions: tuple[ca.Function, ...]) -> dict[str, int]:
    """What the C drivers need to know: sizes of vectors by macro name.

    Args:
        functions: ``derive_step, step`` and, if there is a shortcut, ``derive_shortcut, shortcut``.
    """
    derive, step, *shortcut = functions
    sizes = {
        "STATES": step.numel_in("state"),
        "EXOGENOUS": step.numel_in("exogenous"),
        "PARAMETERS": step.numel_in("parameters"),
        "COLUMNS": step.numel_out("row"),
        "STEP_DERIVED": derive.numel_out("derived"),
        "HAS_SHORTCUT": int(bool(shortcut)),
    }
    return sizes | ({"SHORTCUT_DERIVED": shortcut[0].numel_out("derived")} if shortcut else {})


def rollout_source(step: ca.Function, shortcut: ca.Function | None = None) -> str:
    """C99 translation unit that runs a step for many samples.

    Args:
        step: ``step(state, exogenous, parameters) -> (next_state, row, margin)``.
        shortcut: ``shortcut(state, exogenous, parameters) -> (next_state, row, margin, valid)``, a cheaper step
            that gives the same numbers wherever ``valid > 0``; the step is then left out.
    """
    functions = hoisted(step) + (hoisted(shortcut) if shortcut is not None else ())
    sizes = sizes_of(functions)
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    driver = (files("codegen") / "rollout.c").read_text(encoding="utf-8")
    return "\n".join([*lines, c_source(list(functions)), driver])


@dataclass(frozen=True)
class Rollout:
    """A compiled rollout.

    Attributes:
        columns: number of values in a row.
        path: the library it was loaded from.
    """

    columns: int
    path: Path
    _call: "ctypes._NamedFuncPointer"

    def __call__(
        self,
        parameters: NDArray[np.float64],
        exogenous: NDArray[np.float64],
        state: NDArray[np.float64],
        stride: int = 1,
    ) -> tuple[int, int, NDArray[np.float64]]:
        """Run until `exogenous` is used up or the run ends early; Python's lock is released meanwhile.

        Args:
            parameters: (parameters,) float64.
            exogenous: (samples, exogenous) float64, C-contiguous.
            state: (states,) float64; overwritten with the final state.
            stride: every how many samples a row is kept; 0 keeps none.

        Returns:
            Outcome, number of samples stepped, rows (kept rows, columns).
        """
        samples = exogenous.shape[0]
        kept = -(-samples // stride) if stride else 0
        rows = np.empty((kept, self.columns))
        done = ctypes.c_int64()
        outcome = self._call(
            parameters.ctypes.data,
            exogenous.ctypes.data,
            state.ctypes.data,
            samples,
            max(stride, 1),
            rows.ctypes.data if stride else None,
            ctypes.byref(done),
        )
        return outcome, done.value, rows[: -(-done.value // stride) if stride else 0]


@cache
def compile_rollout(
    step: ca.Function, shortcut: ca.Function | None = None, compiler: Compiler | None = None
) -> Rollout:
    """Compile (or find in the cache) and load the rollout of a step.

    Args:
        step: ``step(state, exogenous, parameters) -> (next_state, row, margin)``.
        shortcut: a cheaper step for where it is valid; see `rollout_source`.
        compiler: by default the one `find_compiler` finds.

    Raises:
        CompilerNotFoundError: there is no C compiler.
        CompileError: it failed.
        CacheError: the cache folder cannot be used.
    """
    path = library(rollout_source(step, shortcut), compiler or find_compiler())
    call = ctypes.CDLL(str(path)).rollout
    call.restype = ctypes.c_int
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    call.argtypes = [pointer, pointer, pointer, count, count, pointer, ctypes.POINTER(count)]
    return Rollout(step.numel_out("row"), path, call)
