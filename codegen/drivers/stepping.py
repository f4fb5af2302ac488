"""Parallel runs of a sampled system under external commands, a few samples per call."""

import ctypes
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import SCHEDULED, Compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.unit import all_read, hoisted_all, macros_of_lists, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes, paired
from dualwinch.codegen.source.expressions import GRAPHS

DRIVER = ("sampled_lanes.h", "stepping.c")


@dataclass(frozen=True)
class Commanded:
    """A sampled system under external commands.

    Attributes:
        system: the system.
        sense: ``sense(state, exogenous, parameters) -> observation``, the observation before a command.
        commands: for each command, the indices of the states that it sets.
    """

    system: Sampled
    sense: ca.Function
    commands: tuple[tuple[int, ...], ...]

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the vectors, by the names of their C macros."""
        observed = {"OBSERVED": self.sense.numel_out("observation"), "COMMANDS": len(self.commands)}
        return self.system.sizes | observed


def stepping_source(commanded: Commanded, compiler: Compiler, *, exact: bool) -> str:
    """C99 translation unit that steps runs; `exact`: one by one, with the operations of a single rollout."""
    functions = hoisted_all((*commanded.system.functions, commanded.sense))
    pairs = [(of, state) for of, states in enumerate(commanded.commands) for state in states]
    listed = macros_of_lists(
        READ_EXOGENOUS=all_read(functions, "exogenous"),
        COMMAND_OF=[of for of, _ in pairs],
        COMMANDED_STATES=[state for _, state in pairs],
    )
    if exact:
        sizes = commanded.sizes | {"LANES": 1, "PAIRED": 0}
        return unit(sizes, functions, "lanes.h", c_source(functions), listed, *DRIVER)
    in_pairs = paired(functions, compiler)
    lanes = {function.name(): LaneLayout(paired=in_pairs, shared=("part",)) for function in functions}
    source, sizes = c_source(functions, lanes=lanes), commanded.sizes | lane_sizes(paired=in_pairs)
    return unit(sizes, functions, "elementary.h", "lanes.h", source, listed, *DRIVER)


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
        lanes: runs per block.
        sizes: sizes of the vectors, by the names of their C macros.
        library: functions of stepping.c.
    """

    lanes: int
    sizes: Mapping[str, int]
    library: ctypes.CDLL

    @property
    def constants(self) -> int:
        """Number of values that a block derives from its parameters."""
        return ctypes.c_int64.in_dll(self.library, "constants_size").value


@with_compiler
@GRAPHS.cached
def compile_stepping(compiler: Compiler, commanded: Commanded, *, exact: bool) -> Stepping:
    """Compile (or find in the cache) and load the stepping of runs; see `compile_rollout`.

    Args:
        compiler: that of `find_compiler`, no argument of the caller.
        commanded: the system.
        exact: with the operations of a single rollout, one run after the other; else `LANES` runs in parallel, with
            elementary functions of a relative error up to 1e-9.
    """
    flags = lane_flags(compiler) if not exact else () if compiler.is_clang else SCHEDULED
    signatures = {"prepare": "pp", "look": "pnn", "odd_command": "p -> n", "step": "pnnnp -> n"}
    functions = *commanded.system.functions, commanded.sense
    made_of = recipe(functions, "stepping", commanded.system.parts, commanded.commands, exact)
    driver = loaded(lambda: stepping_source(commanded, compiler, exact=exact), compiler, flags, made_of, **signatures)
    return Stepping(1 if exact else LANES, commanded.sizes, driver)


Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CACHE_LINE = 64
"""Alignment in bytes that compiled code expects of its arrays."""


def _aligned(*shape: int) -> Floats:
    """An array of zeros aligned to a cache line."""
    size = int(np.prod(shape)) * 8
    raw = np.zeros(size + CACHE_LINE, np.uint8)
    start = -_address(raw) % CACHE_LINE
    return raw[start : start + size].view(np.float64).reshape(shape)


def _address(array: NDArray) -> int:
    return array.__array_interface__["data"][0]


class SteppedRuns:
    """Runs of a sampled system; see stepping.c.

    Attributes:
        commands: (runs, commands), read at every step.
        observation: (signals, runs), overwritten by every step.
        outcomes: (runs,) values of `Outcome`.
        done: (runs,) samples stepped.
        columns: number of values in a row.
        pointers: addresses of these arrays, valid until runs are started again.
    """

    def __init__(self, code: Stepping, count: int, samples: int, *, shared: bool) -> None:
        """Allocate runs; they count as ended until they are started.

        Args:
            code: compiled stepping.
            count: number of runs.
            samples: number of samples of a run.
            shared: whether all have the same parameters.
        """
        self._code, self._count, self._samples, self._shared = code, count, samples, shared
        self._blocks = blocks = -(-count // code.lanes)
        room, sizes = blocks * code.lanes, code.sizes
        self.columns = sizes["COLUMNS"]
        self.commands = np.zeros((count, sizes["COMMANDS"]))
        self.observation = np.zeros((sizes["OBSERVED"], count))
        self._state = _aligned(blocks, sizes["STATES"], code.lanes)
        self._outcome, self._done = np.full(room, Outcome.COMPLETED, np.int64), np.zeros(room, np.int64)
        self._nothing = np.zeros(sizes["EXOGENOUS"])
        self._lines = np.full(room, _address(self._nothing), np.uint64)
        # replaced, never overwritten, once runs have been started, as copies share them
        self._constants = _aligned(1 if shared else blocks, code.constants)
        self._parameters = np.zeros((1 if shared else blocks, code.lanes, sizes["PARAMETERS"]))
        self._point()

    def _point(self) -> None:
        """Collect the addresses of all arrays for the compiled code."""
        arrays = self._lines, self._state, self._outcome, self._done, self.commands, self.observation
        addresses = [_address(array) for array in arrays]
        self.pointers = Pointers(
            _address(self._constants), int(not self._shared), *addresses, self._count, self._samples
        )
        self._at = ctypes.addressof(self.pointers)
        self.outcomes, self.done = self._outcome[: self._count], self._done[: self._count]

    def start(self, runs: Indices, states: Floats, parameters: Floats) -> None:
        """Start or restart some runs.

        Args:
            runs: (n,) their indices.
            states: (n, states) before the first sample.
            parameters: (n, parameters); with shared parameters only the first row of the first call is used.
        """
        blocks, lanes = np.divmod(runs, self._code.lanes)
        self._state[blocks, :, lanes] = states
        self._outcome[runs], self._done[runs] = Outcome.RUNNING, 0
        if not self._parameters.any():  # idle lanes, too, need valid parameters
            self._parameters = self._parameters + parameters[0]
            self._prepare(range(len(self._parameters)))
        if not (self._shared or np.array_equal(self._parameters[blocks, lanes], parameters)):
            self._parameters = self._parameters.copy()
            self._parameters[blocks, lanes] = parameters
            self._prepare(np.unique(blocks).tolist())
        self._point()

    def _prepare(self, blocks: Iterable[int]) -> None:
        """Recompute the constants derived from the parameters of some blocks."""
        before, self._constants = self._constants, _aligned(*self._constants.shape)
        self._constants[:] = before
        for block in blocks:
            self._code.library.prepare(self._parameters[block], self._constants[block])

    def read(self, runs: Indices | int, lines: NDArray[np.uint64] | int) -> None:
        """Continue runs with the signals of other tables: (n,) addresses of the rows of their next samples."""
        self._lines[runs] = lines

    def look(self) -> None:
        """Update the observation of all runs."""
        self._code.library.look(self._at, 0, self._blocks)

    def odd_command(self) -> tuple[int, int] | None:
        """Run and command of the first command that is not finite, among the running runs."""
        odd = self._code.library.odd_command(self._at)
        return None if odd < 0 else divmod(odd, self._code.sizes["COMMANDS"])

    def step(self, samples: int, threads: int = 1, row: int | None = None) -> int:
        """Step all running runs and observe them, without the global interpreter lock.

        Args:
            samples: largest number of samples; a run may end earlier.
            threads: number of threads.
            row: address of (samples, columns) for the rows of a single run.

        Returns:
            Number of runs still running.
        """
        if threads == 1:
            return self._code.library.step(self._at, 0, self._blocks, samples, row)
        ends = [round(self._blocks * share / threads) for share in range(threads + 1)]
        tasks = [
            _pool(threads - 1).submit(self._code.library.step, self._at, begin, last, samples, None)
            for begin, last in pairwise(ends[1:])
        ]
        return self._code.library.step(self._at, 0, ends[1], samples, row) + sum(other.result() for other in tasks)

    def states(self, runs: Indices) -> Floats:
        """(n, states) of some runs."""
        blocks, lanes = np.divmod(runs, self._code.lanes)
        return self._state[blocks, :, lanes]

    def copies(self, runs: Indices) -> "SteppedRuns":
        """Independent copies of some runs (n,) in their present state."""
        blocks, lanes = np.divmod(runs, self._code.lanes)
        other = SteppedRuns(self._code, len(runs), self._samples, shared=self._shared)
        is_every_run = np.array_equal(runs, np.arange(self._count))
        if self._shared or is_every_run:
            vars(other).update(_parameters=self._parameters, _constants=self._constants)
        parameters = self._parameters[0, :1] if self._shared else self._parameters[blocks, lanes]
        other.start(np.arange(len(runs)), self.states(runs), parameters)
        other.read(np.arange(len(runs)), self._lines[runs])
        other.restore(self.outcomes[runs], self.done[runs], self.commands[runs], self.observation[:, runs])
        return other

    def restore(self, outcomes: Indices, done: Indices, commands: Floats, observation: Floats) -> None:
        """Set the progress, commands and observation of all runs; `start` sets their states."""
        self.outcomes[:], self.done[:] = outcomes, done
        self.commands[:], self.observation[:] = commands, observation


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="stepping")
