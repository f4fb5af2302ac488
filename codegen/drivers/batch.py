"""Many rollouts at once in compiled C: one set of parameters in each vector lane."""

import ctypes
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.signals.signals import CompiledFill, Signals, compile_fill
from dualwinch.codegen.drivers.unit import all_read, hoisted_all, kept_rows, macros_of_lists, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes, paired
from dualwinch.codegen.source.expressions import BUILDING, GRAPHS

Floats = NDArray[np.float64]

EVERY_SAMPLE = ("sample", "fast_sample", "one_step")
"""Functions called at samples; they take only the parameters they use, packed for the processor's cache."""


def batch_source(system: Sampled, compiler: Compiler) -> str:
    """C99 translation unit for rollouts of a sampled system in LANES vector lanes, for a compiler."""
    with BUILDING:
        functions = hoisted_all([function for function in system.functions if function is not system.observe])
    often = [function for function in functions if function.name() in EVERY_SAMPLE]
    read, used = all_read(system.functions, "exogenous"), all_read(often, "parameters")
    listed = macros_of_lists(USED_PARAMETERS=used, READ_EXOGENOUS=read)
    sizes = system.sizes | {"READ": len(read)}
    packed = {function.name(): {"parameters": used} for function in often}
    return _in_lanes(sizes, functions, compiler, read, packed, listed, "sampled_lanes.h", "batch.c")


def rows_source(system: Sampled, compiler: Compiler) -> str:
    """C99 translation unit for the rows of these rollouts: a third of the code, and most rollouts keep none."""
    with BUILDING:
        functions = hoisted_all([system.observe])
    return _in_lanes(system.sizes, functions, compiler, all_read(system.functions, "exogenous"), {}, "rows.c")


def _in_lanes(
    sizes: Mapping[str, int],
    functions: Sequence[ca.Function],
    compiler: Compiler,
    read: Sequence[int],
    packed: Mapping[str, Mapping[str, Sequence[int]]],
    *driver: str,
) -> str:
    """A unit of functions in lanes that takes the exogenous signals `read`, and further inputs packed by function."""
    in_pairs = paired(functions, compiler)
    lanes = {
        name: LaneLayout(paired=in_pairs, shared=("part",), packed={"exogenous": read, **packed.get(name, {})})
        for name in (function.name() for function in functions)
    }
    source = c_source(functions, lanes=lanes)
    return unit(dict(sizes) | lane_sizes(paired=in_pairs), functions, "elementary.h", "lanes.h", source, *driver)


class Recorder(ctypes.Structure):
    """``Recorder`` of batch.c."""

    alive: Floats
    _fields_ = (("begin", ctypes.c_void_p), ("at", ctypes.c_void_p), ("derived", ctypes.c_void_p))


@dataclass(frozen=True)
class Batch:
    """A compiled batch rollout of LANES sets of parameters at a time.

    Attributes:
        columns: number of values in a row.
        read: indices of the exogenous signals in use.
        fill: their generator.
        recording: the library of `rows_source`; or None, where no rows can be kept.
    """

    columns: int
    read: tuple[int, ...]
    fill: CompiledFill
    recording: ctypes.CDLL | None
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
            stride: every `stride`-th sample keeps a row, if compiled with rows; 0: none.
            watched: index of a state.
            most: a run in which that state exceeds this is stopped (`Outcome.GIVEN_UP`); checked from time to time.

        Returns:
            `Outcome` of each (LANES,), samples stepped (LANES,), rows (LANES, kept, columns), NaN after an early end.
        """
        row_count = kept_rows(samples, stride)
        rows = np.full((LANES, row_count, self.columns), np.nan)
        outcome, counts = np.zeros(LANES, np.int64), np.zeros(LANES, np.int64)
        distinct = list(dict.fromkeys(signals))
        records = np.array([source.records[list(self.read)] for source in distinct])
        sources = self.fill.prepared(records, np.array([distinct.index(lane) for lane in signals]))
        receiving = self.fill.address, ctypes.byref(sources)
        recorder = self._recorder() if stride else None
        writing = recorder and ctypes.byref(recorder), stride, rows, row_count
        self._call(parameters, *receiving, state, samples, *writing, watched, most, outcome, counts)
        for lane in np.flatnonzero(outcome != Outcome.COMPLETED):
            rows[lane, kept_rows(counts[lane], stride) :] = np.nan
        return outcome, counts, rows

    def _recorder(self) -> Recorder:
        """What a block of runs needs to keep rows."""
        if self.recording is None:
            raise ValueError("compiled without rows")
        derived = np.empty(ctypes.c_int64.in_dll(self.recording, "derived_size").value)
        functions = (
            ctypes.cast(function, ctypes.c_void_p) for function in (self.recording.begin_rows, self.recording.row_at)
        )
        recorder = Recorder(*functions, derived.ctypes.data)
        recorder.alive = derived
        return recorder


def compile_batch(system: Sampled, *, rows: bool = False) -> Batch:
    """Compile (or find in the cache) and load the batch rollout of a sampled system; see `compile_rollout`.

    Args:
        system: the system.
        rows: whether it can keep rows; their code is compiled beside that of the rollout.
    """
    if not rows:
        return _compile_batch(system)
    with ThreadPoolExecutor(1) as beside:
        recording = beside.submit(copy_context().run, _compile_rows, system)
        return replace(_compile_batch(system), recording=recording.result())


@with_compiler
@GRAPHS.cached
def _compile_batch(compiler: Compiler, system: Sampled) -> Batch:
    made_of = recipe(system.functions, "batch", system.parts)
    source, flags = (lambda: batch_source(system, compiler)), lane_flags(compiler)
    driver = loaded(source, compiler, flags, made_of, batch="ppppnpnpnnxpp")
    count = ctypes.c_int64.in_dll(driver, "signals_read_count").value
    read = tuple((ctypes.c_int * count).in_dll(driver, "signals_read"))
    return Batch(system.observe.numel_out("row"), read, compile_fill(compiler), None, driver.batch)


@with_compiler
@GRAPHS.cached
def _compile_rows(compiler: Compiler, system: Sampled) -> ctypes.CDLL:
    made_of = recipe(system.functions, "rows", system.parts)
    source, flags = (lambda: rows_source(system, compiler)), lane_flags(compiler)
    return loaded(source, compiler, flags, made_of, begin_rows="pp", row_at="ppppp")
