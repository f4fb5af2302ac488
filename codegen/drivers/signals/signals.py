"""Signals of a run sample by sample, given or random: filled by compiled C, or by NumPy to the same bits."""

from collections.abc import Callable, Sequence
from copy import copy
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.signals.fill import compile_fill
from dualwinch.codegen.drivers.signals.in_numpy import fill
from dualwinch.codegen.drivers.signals.kinds import KINDS, Drawn
from dualwinch.codegen.errors import DualwinchError

Floats: TypeAlias = NDArray[np.float64]

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

Fill: TypeAlias = Callable[[NDArray[np.void], int, Floats], None]
"""``(signals, first, table)``: fills a table (samples, signals) from the sample `first` on and moves the states on."""


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
        (self.records,) = records_of(random, 1)
        self._held: list[Floats | None] = []

    def of_many(self, random: Sequence[Drawn | None], count: int) -> "list[Signals]":
        """Signals of many runs, of which the same is given as of these.

        Args:
            random: the random part of each signal, whose numbers may be arrays (count,).
            count: number of the runs.
        """
        records = records_of(random, count)
        records["given"], records["given_from"] = self.records["given"], self.records["given_from"]
        return [self._with(row) for row in records]

    def _with(self, records: NDArray[np.void]) -> "Signals":
        other = copy(self)
        other.records = records
        return other

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


def records_of(random: Sequence[Drawn | None], count: int) -> NDArray[np.void]:
    """What `SIGNAL` says of random parts, whose numbers may be arrays (count,); (count, signals).

    Where a standard deviation is zero there is none.
    """
    records = np.zeros((count, len(random)), SIGNAL)
    for column, signal in zip(records.T, random, strict=True):
        if signal is not None:
            column["kind"] = np.where(getattr(signal, "sigma", 1.0), KINDS[type(signal)], 0)
            for name, value in vars(signal).items():
                column[name] = value
    return records


def _filler(signals: NDArray[np.void]) -> Fill:
    """C where something is drawn and there is a compiler that works, else NumPy."""
    if not signals["kind"].any():
        return fill
    try:
        return compile_fill(find_compiler())
    except DualwinchError:
        return fill
