"""Signals of a run sample by sample, given or random, by compiled C (fill.c) or by NumPy with the same bits."""

import ctypes
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from math import sqrt
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.signals.draws import blocks, normal_source, normals, uniforms, words
from dualwinch.codegen.drivers.unit import unit
from dualwinch.codegen.errors import DualwinchError

Floats: TypeAlias = NDArray[np.float64]

NO_LIMIT = sys.float_info.max
"""Limit of a signal without one."""


@dataclass(frozen=True)
class RandomSignal:
    """A first-order Gauss–Markov signal, stationary from its first sample, or from zero before it.

    Attributes:
        seed: a whole number below 2^64.
        stream: its number, below 2^64: signals of one seed with different numbers are independent.
        sigma: standard deviation.
        decay: autocorrelation from sample to sample; 0 is white noise.
        limit: largest magnitude.
        from_zero: whether it is zero before its first sample.
    """

    seed: int
    stream: int
    sigma: float
    decay: float = 0.0
    limit: float = NO_LIMIT
    from_zero: bool = False


@dataclass(frozen=True)
class UniformSignal:
    """White noise, uniform in [-1, 1].

    Attributes:
        seed, stream: as in `RandomSignal`.
    """

    seed: int
    stream: int


@dataclass(frozen=True)
class OutageSignal:
    """1 in an outage, else 0; each time window has one outage.

    Attributes:
        seed, stream: as in `RandomSignal`.
        period: samples of a window, from 1 to 2^32 - 1.
        length: mean length of an outage in samples, below 2^31. The length is uniform between half and one and a half
            times the mean, limited to the window; the start is uniform among those that end within the window.
    """

    seed: int
    stream: int
    period: int
    length: int


Drawn: TypeAlias = RandomSignal | UniformSignal | OutageSignal

NORMAL, UNIFORM, OUTAGES = 1, 2, 3
"""Kinds of random parts in sources.h; 0: none."""

SIGNAL_KINDS: dict[type[Drawn], int] = {RandomSignal: NORMAL, UniformSignal: UNIFORM, OutageSignal: OUTAGES}

SIGNAL = np.dtype(
    [
        *(("given", np.uintp), ("given_from", np.int64)),
        *(("kind", np.int64), ("seed", np.uint64), ("stream", np.uint64)),
        *(("sigma", float), ("decay", float), ("limit", float), ("state", float)),
        *(("period", np.int64), ("length", np.int64), ("from_zero", np.int64)),
    ],
    align=True,
)
"""``Signal`` of sources.h."""

Records: TypeAlias = NDArray[np.void]
"""Signals as numbers, of the type `SIGNAL`."""


class Signals:
    """Signals of a run, each the sum of a given and a random part, filled piece by piece.

    Attributes:
        records: (signals,) of `SIGNAL`; filling samples advances their states.
    """

    def __init__(self, random: Sequence[Drawn | None]) -> None:
        """Set up the signals.

        Args:
            random: the random part of each signal, or ``None``.
        """
        (self.records,) = _records(random, 1)
        self._given: list[Floats | None] = []

    def of_many(self, random: Sequence[Drawn | None], count: int) -> "list[Signals]":
        """Signals of many runs with the same given parts.

        Args:
            random: the random part of each signal, with numbers or arrays (count,).
            count: number of runs.
        """
        records = _records(random, count)
        records["given"], records["given_from"] = self.records["given"], self.records["given_from"]
        runs: list[Signals] = [copy(self) for _ in records]
        for run, row in zip(runs, records, strict=True):
            run.records = row
        return runs

    def give(self, given: Sequence[Floats | None], first: int = 0) -> None:
        """Set the given parts.

        Args:
            given: the given part of each signal, (samples,), or ``None`` for zero.
            first: number of the first of these samples.
        """
        self._given = [None if values is None else np.ascontiguousarray(values, float) for values in given]
        self.records["given"] = [0 if values is None else values.ctypes.data for values in self._given]
        self.records["given_from"] = first

    def pieces(self, length: int, samples: int, shortest: int) -> Iterator[Floats]:
        """Samples from the first one on, (samples, signals), in tables of growing length from `shortest` to `length`.

        The short first table is available soon.
        """
        start, piece = 0, min(shortest, length)
        while start < samples:
            table = np.empty((min(piece, samples - start), len(self.records)))
            self.fill(table, start)
            yield table
            start, piece = start + len(table), min(2 * piece, length)

    def fill(self, table: Floats, first: int) -> None:
        """Fill a table with samples, in consecutive pieces, without the global interpreter lock.

        The bits do not depend on the division into pieces, and are the same in C and in NumPy, which is used without a
        compiler or random parts.

        Args:
            table: (samples, signals), overwritten.
            first: number of its first sample.
        """
        filler: Callable[[Records, int, Floats], None] = fill
        if self.records["kind"].any():
            with suppress(DualwinchError):
                filler = compile_fill(find_compiler())
        filler(self.records, first, table)


def _records(random: Sequence[Drawn | None], count: int) -> Records:
    """Random parts, with numbers or arrays (count,), as (count, signals) of `SIGNAL`; none for a deviation of zero."""
    records = np.zeros((count, len(random)), SIGNAL)
    for column, signal in zip(records.T, random, strict=True):
        if signal is not None:
            column["kind"] = np.where(getattr(signal, "sigma", 1.0), SIGNAL_KINDS[type(signal)], 0)
            for name, value in vars(signal).items():
                column[name] = value
    return records


WIDE = ("-mprefer-vector-width=512",)
"""Additional flags; as those of every build, they do not affect rounding: every compiler gives the same bits."""

FILL_PARTS = (
    *("elementary.h", "signals/philox.h", normal_source(), "signals/normal.h"),
    *(f"signals/{name}" for name in ("sources.h", "outages.h", "bundle.h", "fill.c")),
)
"""Texts of fill.c and its headers, for `unit`."""

ALONE = np.zeros(1, np.int64)
"""The source of a single lane."""


class Sources(ctypes.Structure):
    """Signals of runs in lanes; ``Sources`` of sources.h."""

    _fields_ = (
        ("signals", ctypes.c_void_p),
        ("source", ctypes.c_void_p),
        *((name, ctypes.c_int64) for name in ("sources", "count", "lanes")),
        ("bundles", ctypes.c_void_p),
        ("drawn", ctypes.c_int64),
    )


@dataclass(frozen=True)
class CompiledFill:
    """fill.c for one run, as `fill`, or for runs in vector lanes."""

    _library: ctypes.CDLL

    def __call__(self, signals: Records, first: int, table: Floats) -> None:
        """Fill a table without the global interpreter lock."""
        self._library.fill(ctypes.byref(self.prepared(signals[np.newaxis])), first, len(table), table)

    def in_lanes(self, runs: Sequence[Signals], length: int, samples: int) -> Iterator[Floats]:
        """Samples of at most 16 parallel runs, in tables (samples, signals, runs) of at most `length` samples."""
        sources = self.prepared(np.stack([run.records for run in runs]), np.arange(len(runs)))
        for start in range(0, samples, length):
            table = np.empty((min(length, samples - start), len(runs[0].records), len(runs)))
            self._library.fill(ctypes.byref(sources), start, len(table), table)
            yield table

    def prepared(self, records: Records, source: NDArray[np.int64] = ALONE) -> Sources:
        """Signals of lanes, for ``fill`` to fill tables (samples, signals, lanes) piece by piece.

        Args:
            records: (sources, signals) of `SIGNAL`, C-contiguous; filling samples advances their states.
            source: (lanes,) index of each lane's source; 16 lanes at most.
        """
        room = records.shape[1], ctypes.c_int64.in_dll(self._library, "bundle_size").value
        bundles = np.empty(room, np.uint8)
        sources = Sources(records.ctypes.data, source.ctypes.data, *records.shape, len(source), bundles.ctypes.data)
        sources.alive = records, source, bundles
        self._library.prepare(ctypes.byref(sources))
        return sources

    @property
    def address(self) -> int | None:
        """Address of ``fill``, for calls from other compiled code."""
        return ctypes.cast(self._library.fill, ctypes.c_void_p).value


@cache
def compile_fill(compiler: Compiler) -> CompiledFill:
    """Compile (or find in the cache) and load fill.c.

    Raises:
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used.
    """
    return CompiledFill(loaded(unit({}, [], *FILL_PARTS), compiler, WIDE, prepare="p", fill="pnnp"))


def fill(signals: Records, first: int, table: Floats) -> None:
    """Fill a table with samples from sample `first` on in NumPy, and advance the signals' states.

    Args:
        signals: (signals,) of `SIGNAL`.
        first: number of the first sample.
        table: (samples, signals), overwritten.
    """
    generators = {NORMAL: _gauss_markov, UNIFORM: _uniform, OUTAGES: _outages}
    for column, signal in zip(table.T, signals, strict=True):
        column[:] = 0.0
        if signal["given"]:
            shift = 8 * (first - int(signal["given_from"]))
            address = ctypes.cast(int(signal["given"]) + shift, ctypes.POINTER(ctypes.c_double))
            column[:] = np.ctypeslib.as_array(address, (len(column),))
        if signal["kind"] and len(column):
            column[:] += generators[int(signal["kind"])](signal, first, len(column))


def _gauss_markov(signal: np.void, first: int, samples: int) -> Floats:
    values = normals(words(int(signal["seed"]), int(signal["stream"]), first, samples))
    sigma, decay, limit = (float(signal[name]) for name in ("sigma", "decay", "limit"))
    fresh = sqrt(1.0 - decay * decay)
    if first == 0 and signal["from_zero"]:
        values[0] *= fresh
    if decay:
        fed = values.tolist()
        start = fed.pop(0) if first == 0 else float(signal["state"])
        states = accumulate(fed, lambda state, draw: decay * state + fresh * draw, initial=start)
        values = np.array(list(states)[-samples:])
    signal["state"] = values[-1]
    return (sigma * values).clip(-limit, limit)


def _uniform(signal: np.void, first: int, samples: int) -> Floats:
    values = uniforms(words(int(signal["seed"]), int(signal["stream"]), first, samples))
    signal["state"] = values[-1]
    return values


def _outages(signal: np.void, first: int, samples: int) -> Floats:
    period, mean = int(signal["period"]), int(signal["length"])
    window, since_start = np.divmod(np.arange(first, first + samples), period)
    start, end = first // period, -(-(first + samples) // period)
    for_length, for_begin, *_ = blocks(int(signal["seed"]), int(signal["stream"]), start, end - start).T
    half = mean // 2
    length = np.minimum(mean - half + _below(np.array(2 * half + 1), for_length), period)
    begin = _below(period + 1 - length, for_begin)
    since = since_start - begin[window - start]
    return ((since >= 0) & (since < length[window - start])).astype(float)


def _below(count: NDArray[np.int64], drawn: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Uniform integers from 0 to count - 1, from words."""
    return (count.astype(np.uint64) * drawn >> np.uint64(32)).astype(np.int64)
