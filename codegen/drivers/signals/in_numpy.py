"""Fills tables with signals in NumPy: the bits of fill.c without a compiler."""

import ctypes
from collections.abc import Callable
from itertools import accumulate
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.signals.kinds import NORMAL, OUTAGES, UNIFORM
from dualwinch.codegen.drivers.signals.normal import normals, uniforms
from dualwinch.codegen.drivers.signals.philox import blocks, words

Floats = NDArray[np.float64]


def fill(signals: NDArray[np.void], first: int, table: Floats) -> None:
    """Fill a table; see `codegen.drivers.signals.signals.Fill`."""
    for column, signal in zip(table.T, signals, strict=True):
        column[:] = 0.0
        if signal["given"]:
            shift = 8 * (first - int(signal["given_from"]))
            address = ctypes.cast(int(signal["given"]) + shift, ctypes.POINTER(ctypes.c_double))
            column[:] = np.ctypeslib.as_array(address, (len(column),))
        if signal["kind"] and len(column):
            column[:] += DRAWS[int(signal["kind"])](signal, first, len(column))


def _gauss_markov(signal: np.void, first: int, samples: int) -> Floats:
    drawn = normals(words(int(signal["seed"]), int(signal["stream"]), first, samples))
    sigma, decay, limit = (float(signal[name]) for name in ("sigma", "decay", "limit"))
    fresh = sqrt(1.0 - decay * decay)
    if first == 0 and signal["from_zero"]:
        drawn[0] *= fresh
    if decay:
        fed = drawn.tolist()
        start = fed.pop(0) if first == 0 else float(signal["state"])
        states = accumulate(fed, lambda state, draw: decay * state + fresh * draw, initial=start)
        drawn = np.array(list(states)[-samples:])
    signal["state"] = drawn[-1]
    return (sigma * drawn).clip(-limit, limit)


def _uniform(signal: np.void, first: int, samples: int) -> Floats:
    drawn = uniforms(words(int(signal["seed"]), int(signal["stream"]), first, samples))
    signal["state"] = drawn[-1]
    return drawn


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
    return (count.astype(np.uint64) * drawn >> np.uint64(32)).astype(np.int64)


DRAWS: dict[int, Callable[[np.void, int, int], Floats]] = {
    NORMAL: _gauss_markov,
    UNIFORM: _uniform,
    OUTAGES: _outages,
}
"""Kind → ``(signal, first, samples)``: draws samples and moves the signal's state on."""
