"""Many rollouts at once in compiled C: one set of parameters in each vector lane."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler, find_compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.signals.signals import CompiledFill, Signals, compile_fill
from dualwinch.codegen.drivers.unit import all_read, hoisted_all, kept_rows, macros_of_lists, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.expressions import BUILDING, GRAPHS

Floats = NDArray[np.float64]

EVERY_SAMPLE = ("sample", "fast_sample", "one_step")
"""Functions called at samples; they take only the parameters they use, packed for the processor's cache."""


def batch_source(system: Sampled, compiler: Compiler) -> str:
    """C99 translation unit for rollouts of a sampled system in LANES vector lanes, for a compiler."""
    with BUILDING:
        functions = hoisted_all(system.functions)
    often = [function for function in functions if function.name() in EVERY_SAMPLE]
    read, used = all_read(functions, "exogenous"), all_read(often, "parameters")
    lanes = {
        function.name(): LaneLayout(
            paired=compiler.pairs,
            shared=("part",),
            packed={"exogenous": read} | ({"parameters": used} if function in often else {}),
        )
        for function in functions
    }
    sizes = system.sizes | lane_sizes(compiler) | {"READ": len(read)}
    listed = macros_of_lists(USED_PARAMETERS=used, READ_EXOGENOUS=read)
    source = c_source(functions, lanes=lanes)
    return unit(sizes, functions, "elementary.h", "lanes.h", source, listed, "sampled_lanes.h", "batch.c")


@dataclass(frozen=True)
class Batch:
    """A compiled batch rollout of LANES sets of parameters at a time.

    Attributes:
        columns: number of values in a row.
        read: indices of the exogenous signals in use.
        fill: their generator.
    """

    columns: int
    read: tuple[int, ...]
    fill: CompiledFill
    _call: "ctypes._NamedFuncPointer"

    def __call__(
        self,
        parameters: Floats,
        signals: Sequence[Signals],
        state: Floats,
        samples: int,
        stride: int = 0,
        *,
        watched: int = 0,
        most: float = np.inf,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
        """Run one block of LANES runs without the global interpreter lock.

        Args:
            parameters: (LANES, parameters).
            signals: LANES signals, with their given parts; not changed. Lanes may share an object.
            state: (LANES, states); overwritten with the final states.
            samples: number of samples of the runs.
            stride: every `stride`-th sample keeps a row; 0: none.
            watched: index of a state.
            most: a run in which that state exceeds this is stopped (`Outcome.GIVEN_UP`); checked from time to time.

        Returns:
            `Outcome` of each (LANES,), samples stepped (LANES,), rows (LANES, kept, columns), NaN after an early end.
        """
        kept = kept_rows(samples, stride)
        rows = np.full((LANES, kept, self.columns), np.nan)
        outcome, done = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
        distinct = list(dict.fromkeys(signals))
        records = np.array([source.records[list(self.read)] for source in distinct])
        sources = self.fill.prepared(records, np.array([distinct.index(lane) for lane in signals]))
        receiving = self.fill.address, ctypes.byref(sources)
        writing = max(stride, 1), rows if stride else None, kept
        self._call(parameters, *receiving, state, samples, *writing, watched, most, outcome, done)
        for lane in np.flatnonzero(outcome != Outcome.COMPLETED):
            rows[lane, kept_rows(done[lane], stride) :] = np.nan
        return outcome, done, rows


@with_compiler
@GRAPHS.cached
def compile_batch(system: Sampled, compiler: Compiler | None = None) -> Batch:
    """Compile (or find in the cache) and load the batch rollout of a sampled system; see `compile_rollout`."""
    chosen = compiler or find_compiler()
    made_of = recipe(system.functions, "batch", system.parts)
    driver = loaded(lambda: batch_source(system, chosen), chosen, lane_flags(chosen), made_of, batch="ppppnnpnnxpp")
    count = ctypes.c_int64.in_dll(driver, "signals_read_count").value
    read = tuple((ctypes.c_int * count).in_dll(driver, "signals_read"))
    return Batch(system.observe.numel_out("row"), read, compile_fill(chosen), driver.batch)
