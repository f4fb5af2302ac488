"""Runs of a sampled system side by side, moved on a few samples a call under commands from outside."""

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
from dualwinch.codegen.compiler import SCHEDULED, Compiler, find_compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.unit import all_read, hoisted_all, macros_of_lists, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.expressions import GRAPHS

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

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the vectors, by the names of their C macros."""
        observed = {"OBSERVED": self.sense.numel_out("observation"), "COMMANDS": len(self.commands)}
        return self.system.sizes | observed


def stepping_source(commanded: Commanded, compiler: Compiler, *, exact: bool) -> str:
    """C99 translation unit that moves runs on; `exact`: one by one, with the operations of a single rollout."""
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
    lanes = {function.name(): LaneLayout(paired=not compiler.is_clang, shared=("part",)) for function in functions}
    source, sizes = c_source(functions, lanes=lanes), commanded.sizes | lane_sizes(compiler)
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
        lanes: runs in a block.
        sizes: of the vectors, by the names of their C macros.
        library: functions of stepping.c.
    """

    lanes: int
    sizes: Mapping[str, int]
    library: ctypes.CDLL

    @property
    def constants(self) -> int:
        """How many numbers a block takes of its parameters."""
        return ctypes.c_int64.in_dll(self.library, "constants_size").value


@with_compiler
@GRAPHS.cached
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
    signatures = {"prepare": "pp", "look": "pnn", "odd_command": "p -> n", "step": "pnnnp -> n"}
    functions = *commanded.system.functions, commanded.sense
    made_of = recipe(functions, "stepping", commanded.system.parts, commanded.commands, exact)
    driver = loaded(lambda: stepping_source(commanded, chosen, exact=exact), chosen, flags, made_of, **signatures)
    return Stepping(1 if exact else LANES, commanded.sizes, driver)


Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CACHE_LINE = 64
"""Bytes that compiled code expects its arrays to begin at a multiple of."""


def _aligned(*shape: int) -> Floats:
    """An array of zeros at the beginning of a cache line."""
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
        outcomes: (runs,) of `Outcome`.
        done: (runs,) samples stepped.
        columns: numbers in a row.
        pointers: where all this is, until runs are started anew.
    """

    def __init__(self, code: Stepping, count: int, samples: int, *, shared: bool) -> None:
        """Make room for runs, which have all ended until they are started.

        Args:
            code: what moves them on.
            count: how many.
            samples: of a whole run.
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
        # replaced, never written to, once runs have been started: a copy shares them
        self._constants = _aligned(1 if shared else blocks, code.constants)
        self._parameters = np.zeros((1 if shared else blocks, code.lanes, sizes["PARAMETERS"]))
        self._point()

    def _point(self) -> None:
        """Tell the compiled code where everything is."""
        arrays = self._lines, self._state, self._outcome, self._done, self.commands, self.observation
        addresses = [_address(array) for array in arrays]
        self.pointers = Pointers(
            _address(self._constants), int(not self._shared), *addresses, self._count, self._samples
        )
        self._at = ctypes.addressof(self.pointers)
        self.outcomes, self.done = self._outcome[: self._count], self._done[: self._count]

    def start(self, runs: Indices, states: Floats, parameters: Floats) -> None:
        """Begin some runs anew.

        Args:
            runs: (n,) which.
            states: (n, states) before the first sample.
            parameters: (n, parameters); where all runs share theirs, only the first count, and once for all.
        """
        blocks, lanes = np.divmod(runs, self._code.lanes)
        self._state[blocks, :, lanes] = states
        self._outcome[runs], self._done[runs] = Outcome.RUNNING, 0
        if not self._parameters.any():  # idle lanes compute with numbers that are allowed, too
            self._parameters = self._parameters + parameters[0]
            self._prepare(range(len(self._parameters)))
        if not (self._shared or np.array_equal(self._parameters[blocks, lanes], parameters)):
            self._parameters = self._parameters.copy()
            self._parameters[blocks, lanes] = parameters
            self._prepare(np.unique(blocks).tolist())
        self._point()

    def _prepare(self, blocks: Iterable[int]) -> None:
        """Work out anew what some blocks take of their parameters."""
        before, self._constants = self._constants, _aligned(*self._constants.shape)
        self._constants[:] = before
        for block in blocks:
            self._code.library.prepare(self._parameters[block], self._constants[block])

    def read(self, runs: Indices | int, lines: NDArray[np.uint64] | int) -> None:
        """Let runs go on with the signals of other tables: (n,) addresses of the lines of their coming samples."""
        self._lines[runs] = lines

    def look(self) -> None:
        """Observe all runs as they are."""
        self._code.library.look(self._at, 0, self._blocks)

    def odd_command(self) -> tuple[int, int] | None:
        """Run and command of the first that is not finite, of the runs under way."""
        odd = self._code.library.odd_command(self._at)
        return None if odd < 0 else divmod(odd, self._code.sizes["COMMANDS"])

    def step(self, samples: int, threads: int = 1, row: int | None = None) -> int:
        """Move all runs under way on, and observe them; Python's lock is released meanwhile.

        Args:
            samples: at most; a run ends where it has all its samples, diverges or leaves.
            threads: how many share the work.
            row: address of (samples, columns) for the rows of a single run.

        Returns:
            How many runs are under way after it.
        """
        if threads == 1:
            return self._code.library.step(self._at, 0, self._blocks, samples, row)
        ends = [round(self._blocks * share / threads) for share in range(threads + 1)]
        others = [
            _pool(threads - 1).submit(self._code.library.step, self._at, first, last, samples, None)
            for first, last in pairwise(ends[1:])
        ]
        return self._code.library.step(self._at, 0, ends[1], samples, row) + sum(other.result() for other in others)

    def states(self, runs: Indices) -> Floats:
        """(n, states) of some runs."""
        blocks, lanes = np.divmod(runs, self._code.lanes)
        return self._state[blocks, :, lanes]

    def copies(self, runs: Indices) -> "SteppedRuns":
        """Runs (n,) as they are, in others that go on by themselves."""
        blocks, lanes = np.divmod(runs, self._code.lanes)
        other = SteppedRuns(self._code, len(runs), self._samples, shared=self._shared)
        whole = np.array_equal(runs, np.arange(self._count))
        if self._shared or whole:
            vars(other).update(_parameters=self._parameters, _constants=self._constants)
        parameters = self._parameters[0, :1] if self._shared else self._parameters[blocks, lanes]
        other.start(np.arange(len(runs)), self.states(runs), parameters)
        other.read(np.arange(len(runs)), self._lines[runs])
        other.restore(self.outcomes[runs], self.done[runs], self.commands[runs], self.observation[:, runs])
        return other

    def restore(self, outcomes: Indices, done: Indices, commands: Floats, observation: Floats) -> None:
        """Put all runs where others were; their states are those of `start`."""
        self.outcomes[:], self.done[:] = outcomes, done
        self.commands[:], self.observation[:] = commands, observation


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="stepping")
