"""Signals of a run sample by sample, given or random: filled by compiled C, or by NumPy to the same bits."""

import ctypes
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from math import sqrt
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import library
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.normal import normal_source, normals, uniforms
from dualwinch.codegen.drivers.philox import blocks, words
from dualwinch.codegen.drivers.unit import unit
from dualwinch.codegen.errors import DualwinchError

Floats: TypeAlias = NDArray[np.float64]

NO_LIMIT = sys.float_info.max
"""Limit of a signal without one."""

SIGNAL = np.dtype(
    [
        *(("given", np.uintp), ("given_from", np.int64)),
        *(("kind", np.int64), ("seed", np.uint64), ("stream", np.uint64)),
        *(("sigma", float), ("decay", float), ("limit", float), ("state", float)),
        *(("period", np.int64), ("length", np.int64)),
    ],
    align=True,
)
"""``Signal`` of signals.c."""

Fill: TypeAlias = Callable[[NDArray[np.void], int, Floats], None]
"""``(signals, first, table)``: fills a table (samples, signals) from the sample `first` on and moves the states on."""


@dataclass(frozen=True)
class RandomSignal:
    """A first-order Gauss–Markov signal, stationary from its first sample.

    Attributes:
        seed: a whole number below 2^64.
        stream: its number, below 2^64: signals of one seed with different numbers are independent.
        sigma: standard deviation.
        decay: of the autocorrelation from sample to sample; 0 is white noise.
        limit: largest magnitude.
    """

    seed: int
    stream: int
    sigma: float
    decay: float = 0.0
    limit: float = NO_LIMIT


@dataclass(frozen=True)
class UniformSignal:
    """White noise, uniform in (-1, 1).

    Attributes:
        seed, stream: as of a `RandomSignal`.
    """

    seed: int
    stream: int


@dataclass(frozen=True)
class OutageSignal:
    """1 in an outage, else 0; each window of time has one outage, somewhere within it.

    Attributes:
        seed, stream: as of a `RandomSignal`.
        period: samples of a window, from 1 to 2^32 - 1.
        length: of an outage in samples, on average, below 2^31: all lengths from half as long to half as long again are
            as likely, but none is longer than its window. Where it begins is as likely anywhere that it ends in time.
    """

    seed: int
    stream: int
    period: int
    length: int


Drawn: TypeAlias = RandomSignal | UniformSignal | OutageSignal
"""What the random part of a signal may be."""

NORMAL, UNIFORM, OUTAGES = 1, 2, 3
"""Their kinds in signals.c; 0 is nothing random."""

KINDS: dict[type[Drawn], int] = {RandomSignal: NORMAL, UniformSignal: UNIFORM, OutageSignal: OUTAGES}


class Signals:
    """Signals of a run, each of what is given and what is random, filled piece by piece.

    Attributes:
        records: (signals,) of `SIGNAL`; their states move on as samples are filled.
    """

    def __init__(self, random: Sequence[Drawn | None]) -> None:
        """Set the signals up.

        Args:
            random: the random part of each signal; ``None`` where there is none.
        """
        self.records = np.zeros(len(random), SIGNAL)
        for row, signal in zip(self.records, random, strict=True):
            if signal is not None:
                row["kind"] = KINDS[type(signal)]
                for name, value in vars(signal).items():
                    row[name] = value
        self._held: list[Floats | None] = []

    def give(self, given: Sequence[Floats | None], first: int = 0) -> None:
        """Say what is given.

        Args:
            given: of each signal, (samples,), or ``None`` for zero.
            first: number of the first of these samples.
        """
        self._held = [None if values is None else np.ascontiguousarray(values, float) for values in given]
        self.records["given"] = [0 if values is None else values.ctypes.data for values in self._held]
        self.records["given_from"] = first

    def fill(self, table: Floats, first: int) -> None:
        """Fill a table with samples; pieces follow each other. Python's lock is released meanwhile.

        The bits are the same however the samples are divided into pieces, in C and without a compiler.

        Args:
            table: (samples, signals), overwritten.
            first: number of its first sample.
        """
        _filler(self.records)(self.records, first, table)


def _filler(signals: NDArray[np.void]) -> Fill:
    """C where something is drawn and there is a compiler that works, else NumPy."""
    if not signals["kind"].any():
        return fill
    try:
        return compile_fill(find_compiler())
    except DualwinchError:
        return fill


def fill(signals: NDArray[np.void], first: int, table: Floats) -> None:
    """Fill a table in NumPy; see `Fill`."""
    for column, signal in zip(table.T, signals, strict=True):
        column[:] = 0.0
        if signal["given"]:
            shift = 8 * (first - int(signal["given_from"]))
            address = ctypes.cast(int(signal["given"]) + shift, ctypes.POINTER(ctypes.c_double))
            column[:] = np.ctypeslib.as_array(address, (len(column),))
        if signal["kind"]:
            column[:] += DRAWS[int(signal["kind"])](signal, first, len(column))


def _gauss_markov(signal: np.void, first: int, samples: int) -> Floats:
    drawn = normals(words(int(signal["seed"]), int(signal["stream"]), first, samples))
    sigma, decay, limit = (float(signal[name]) for name in ("sigma", "decay", "limit"))
    if decay and samples:
        fresh, fed = sqrt(1.0 - decay * decay), drawn.tolist()
        start = fed.pop(0) if first == 0 else float(signal["state"])
        states = accumulate(fed, lambda state, draw: decay * state + fresh * draw, initial=start)
        drawn = np.array(list(states)[-samples:])
        signal["state"] = drawn[-1]
    return (sigma * drawn).clip(-limit, limit)


def _uniform(signal: np.void, first: int, samples: int) -> Floats:
    return uniforms(words(int(signal["seed"]), int(signal["stream"]), first, samples))


def _outages(signal: np.void, first: int, samples: int) -> Floats:
    period, mean = int(signal["period"]), int(signal["length"])
    window, at = np.divmod(np.arange(first, first + samples), period)
    start, stop = first // period, -(-(first + samples) // period)
    for_length, for_begin = blocks(int(signal["seed"]), int(signal["stream"]), start, stop - start)[:2]
    shortest, half = np.uint64(mean - mean // 2), mean // 2
    length = np.minimum(shortest + _below(np.uint64(2 * half + 1), for_length), np.uint64(period))
    begin = _below(np.uint64(period + 1) - length, for_begin)
    since = at - begin.astype(np.int64)[window - start]
    return ((since >= 0) & (since < length.astype(np.int64)[window - start])).astype(float)


def _below(count: NDArray[np.uint64] | np.uint64, drawn: NDArray[np.uint64]) -> NDArray[np.uint64]:
    return count * drawn >> np.uint64(32)


DRAWS: dict[int, Callable[[np.void, int, int], Floats]] = {
    NORMAL: _gauss_markov,
    UNIFORM: _uniform,
    OUTAGES: _outages,
}
"""Kind → ``(signal, first, samples)``: draws samples and moves the signal's state on."""


def signals_source() -> str:
    """C99 translation unit of signals.c.

    The flags of every build leave every operation as it is written: the same bits from every compiler.
    """
    return unit({}, [], "elementary.h", "philox.h", normal_source(), "normal.h", "signals.c")


@dataclass(frozen=True)
class CompiledFill:
    """``fill`` of signals.c; called like `Fill`."""

    _call: "ctypes._NamedFuncPointer"

    def __call__(self, signals: NDArray[np.void], first: int, table: Floats) -> None:
        """Fill a table; Python's lock is released meanwhile."""
        self._call(signals.ctypes.data, len(signals), first, len(table), table.ctypes.data)

    @property
    def address(self) -> int | None:
        """Of the function, for other compiled code to call it."""
        return ctypes.cast(self._call, ctypes.c_void_p).value


@cache
def compile_fill(compiler: Compiler) -> CompiledFill:
    """Compile (or find in the cache) and load ``fill`` of signals.c.

    Raises:
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used.
    """
    call = ctypes.CDLL(str(library(signals_source(), compiler))).fill
    call.restype = None
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    call.argtypes = [pointer, count, count, count, pointer]
    return CompiledFill(call)
