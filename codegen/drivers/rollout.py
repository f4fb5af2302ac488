"""A whole rollout in compiled C: generated functions and a driver loop in one translation unit."""

import ctypes
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import SCHEDULED, Compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.unit import hoisted_all, kept_rows, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.codegen.source.operations import Generator, Style

CONTRACTED = ("-ffp-contract=fast",)
"""Additional flags. Contracted products change the last bits, differently by compiler and processor."""

CASADI_FLAGS = ("-fno-finite-math-only",)
"""Additional flags for CasADi's own C: same rounding, and same comparisons of NaN, as CasADi's virtual machine."""


def rollout_source(system: Sampled, generator: Generator = "dualwinch") -> str:
    """C99 translation unit for the rollout of a sampled system.

    Args:
        system: the system.
        generator: generator of the C of its functions; CasADi's output is used unchanged.
    """
    functions = hoisted_all(system.functions, generator)
    return unit(system.sizes, functions, c_source(functions, Style(generator=generator)), "rollout.c")


@dataclass(frozen=True)
class Rollout:
    """A compiled rollout.

    Attributes:
        columns: number of values in a row.
    """

    columns: int
    _call: "ctypes._NamedFuncPointer"

    def __call__(
        self,
        parameters: NDArray[np.float64],
        exogenous: NDArray[np.float64],
        state: NDArray[np.float64],
        stride: int = 1,
    ) -> tuple[Outcome, int, NDArray[np.float64]]:
        """Run until the end of `exogenous` or an early end of the run, without the global interpreter lock.

        Args:
            parameters: (parameters,) float64.
            exogenous: (samples, exogenous) float64, C-contiguous.
            state: (states,) float64; overwritten with the final state.
            stride: every `stride`-th sample keeps a row; 0: none.

        Returns:
            Outcome, number of samples stepped, rows (kept rows, columns).
        """
        rows, count = np.empty((kept_rows(len(exogenous), stride), self.columns)), ctypes.c_int64()
        row_buffer = rows if stride else None
        outcome = self._call(
            parameters, exogenous, state, len(exogenous), max(stride, 1), row_buffer, ctypes.byref(count)
        )
        return Outcome(outcome), count.value, rows[: kept_rows(count.value, stride)]


@with_compiler
@GRAPHS.cached
def compile_rollout(compiler: Compiler, system: Sampled, generator: Generator = "dualwinch") -> Rollout:
    """Compile (or find in the cache) and load the rollout of a sampled system.

    Args:
        compiler: that of `find_compiler`, no argument of the caller.
        system: the system.
        generator: generator of the C of its functions.

    Raises:
        CompilerNotFoundError: there is no C compiler.
        CompileError: it failed.
        CacheError: the cache folder cannot be used.
    """
    contracted = CONTRACTED if compiler.is_clang else CONTRACTED + SCHEDULED
    flags = contracted if generator == "dualwinch" else CASADI_FLAGS
    made_of = recipe(system.functions, "rollout", system.parts, generator)
    driver = loaded(lambda: rollout_source(system, generator), compiler, flags, made_of, rollout="pppnnpp -> int")
    return Rollout(system.observe.numel_out("row"), driver.rollout)
