"""Fills tables with signals in compiled C, for one run or for runs in vector lanes."""

import ctypes
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler
from dualwinch.codegen.drivers.signals.normal import normal_source
from dualwinch.codegen.drivers.unit import unit

Floats = NDArray[np.float64]

WIDE = ("-mprefer-vector-width=512",)
"""Beside the flags of every build, none of which lets a compiler round otherwise: the same bits from every one."""

ALONE = np.zeros(1, np.int64)
"""The source of a single lane."""


class Sources(ctypes.Structure):
    """What runs in lanes receive; ``Sources`` of sources.h."""

    _fields_ = (
        ("signals", ctypes.c_void_p),
        ("source", ctypes.c_void_p),
        *((name, ctypes.c_int64) for name in ("sources", "count", "lanes")),
        ("bundles", ctypes.c_void_p),
        ("drawn", ctypes.c_int64),
    )


FILL_PARTS = (
    "elementary.h",
    *(
        part if "\n" in part else f"signals/{part}"
        for part in ("philox.h", normal_source(), "normal.h", "sources.h", "outages.h", "bundle.h", "fill.c")
    ),
)
"""Texts of fill.c and of what comes before it, as `unit` takes them."""


def fill_source() -> str:
    """C99 translation unit of fill.c."""
    return unit({}, [], *FILL_PARTS)


@dataclass(frozen=True)
class CompiledFill:
    """fill.c; called like `codegen.drivers.signals.signals.Fill`."""

    _library: ctypes.CDLL

    def __call__(self, signals: NDArray[np.void], first: int, table: Floats) -> None:
        """Fill a table; Python's lock is released meanwhile."""
        sources = self.prepared(signals[np.newaxis])
        self._library.fill(ctypes.byref(sources), first, len(table), table.ctypes.data)

    def prepared(self, records: NDArray[np.void], source: NDArray[np.int64] = ALONE) -> Sources:
        """What lanes receive, for ``fill`` to fill tables (samples, signals, lanes) of it, piece after piece.

        Args:
            records: (sources, signals) of `SIGNAL`, C-contiguous; their states move on as samples are filled.
            source: (lanes,) which of the sources each lane has; 16 lanes at most.
        """
        room = records.shape[1], ctypes.c_int64.in_dll(self._library, "bundle_size").value
        bundles = np.empty(room, np.uint8)
        sources = Sources(records.ctypes.data, source.ctypes.data, *records.shape, len(source), bundles.ctypes.data)
        sources.held = records, source, bundles
        self._library.prepare(ctypes.byref(sources))
        return sources

    @property
    def address(self) -> int | None:
        """Of ``fill``, for other compiled code to call it."""
        return ctypes.cast(self._library.fill, ctypes.c_void_p).value


@cache
def compile_fill(compiler: Compiler) -> CompiledFill:
    """Compile (or find in the cache) and load fill.c.

    Raises:
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used.
    """
    return CompiledFill(loaded(fill_source(), compiler, WIDE, prepare="p", fill="pnnp"))
