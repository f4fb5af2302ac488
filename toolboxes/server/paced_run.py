"""A run of a sampled system in real time that exchanges datagrams with a client (paced_run.c)."""

import ctypes
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import code_cache, compiled, compilers, errors, translation_unit

Floats = NDArray[np.float64]

POSIX = {"_POSIX_C_SOURCE": 200809}
"""Macro that declares sockets and clocks in C99."""

Pair, Triple = ctypes.c_double * 2, ctypes.c_int64 * 3


class Served(ctypes.Structure):
    """`Served` of paced_run.c."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("step", "look", "runs", "line", "lines", "table", "added", "commands")),
        *((name, ctypes.c_void_p) for name in ("observation", "outcome", "done", "rows")),
        *((name, ctypes.c_int64) for name in ("exogenous", "columns", "signals")),
        *((name, ctypes.c_int64) for name in ("socket", "period", "lockstep", "may_write", "watchdog", "release")),
        *((name, Pair) for name in ("safe", "largest", "brake", "lower", "upper")),
        *((name, ctypes.c_int64) for name in ("position", "speed")),
        ("reference", Triple),
        *((name, Pair) for name in ("share", "other")),
        *((name, ctypes.c_int64) for name in ("other_count", "start", "quit")),
        *((name, ctypes.c_int64) for name in ("running", "is_safe", "silences", "connected", "by_datagram", "held")),
        ("held_at", ctypes.c_double),
        *((name, ctypes.c_int64) for name in ("ticks", "missed")),
        *((name, ctypes.c_int64) for name in ("latest", "accepted", "refused", "not_allowed", "bins", "oldest")),
        *((name, ctypes.c_void_p) for name in ("edges", "lateness", "ages")),
    )


@dataclass(frozen=True)
class Pacing:
    """Timing and commands of a run.

    Attributes:
        period: real time of a sample in ns.
        lockstep: whether each sample waits for the client's answer instead.
        may_write: whether commands of clients are accepted.
        watchdog: samples without a command after which the safe commands apply.
        release: time in ns without a datagram after which another client is admitted.
        safe: safe commands.
        brake: what is added to these per m/s of the measured speed, within `lower` and `upper`.
        position, speed: places of the measured position and speed in the observation.
        reference: places of position, speed and acceleration of the reference in the exogenous signals.
        largest: magnitude of each command beyond which it is refused.
        edges: upper edges in ns of the bins of the histogram of lateness; the last bin has none.
        oldest: age in samples of the last bin of commands' ages, which includes all older ones.
    """

    period: int
    lockstep: bool
    may_write: bool
    watchdog: int
    release: int
    safe: tuple[float, float]
    brake: tuple[float, float]
    lower: tuple[float, float]
    upper: tuple[float, float]
    position: int
    speed: int
    reference: tuple[int, int, int]
    largest: tuple[float, float]
    edges: tuple[int, ...]
    oldest: int = 200


class PacedRun:
    """One run, from its first sample to its end; commands and added signals may change during the run.

    Attributes:
        table: (samples + 1, exogenous) exogenous signals of the run; future rows may be overwritten.
        added: (exogenous,) values added to these.
        rows: (samples, columns) result so far.
        lateness: (bins,) histogram of the samples' lateness.
        ages: histogram of the samples by the age of their command.
        shared: data shared by compiled code and other threads.
    """

    def __init__(
        self, code: compiled.Stepping, runs: compiled.SteppedRuns, table: Floats, pacing: Pacing, socket: int
    ) -> None:
        """Allocate the arrays.

        Args:
            code: compiled stepping.
            runs: a single, started run.
            table: see the attribute.
            pacing: timing and commands.
            socket: file descriptor of a bound, non-blocking datagram socket.

        Raises:
            DualwinchError: no compiler, or no POSIX system.
        """
        if os.name != "posix":
            raise errors.DualwinchError("a run in real time needs a POSIX system, such as Linux or macOS")
        self._library, self._kept = _library(), (code, runs)
        self.table, (_, exogenous) = table, table.shape
        self.added, self._lines = np.zeros(exogenous), np.zeros((2, exogenous))
        self.rows = np.zeros((len(table) - 1, runs.columns))
        self.rows.fill(0.0)  # no page faults during the run
        self._edges = np.array(pacing.edges, np.int64)
        self.lateness, self.ages = (np.zeros(size + 1, np.int64) for size in (len(self._edges), pacing.oldest))
        pointers = runs.pointers
        step, look = (ctypes.cast(getattr(code.library, name), ctypes.c_void_p) for name in ("step", "look"))
        arrays = {name: getattr(self, name) for name in ("table", "added", "rows", "lateness", "ages")}
        arrays |= {"lines": self._lines, "edges": self._edges}
        self.shared = Served(
            step=step,
            look=look,
            runs=ctypes.addressof(pointers),
            line=pointers.lines,
            **{name: getattr(pointers, name) for name in ("commands", "observation", "outcome", "done")},
            **{name: array.ctypes.data for name, array in arrays.items()},
            exogenous=exogenous,
            columns=runs.columns,
            signals=len(runs.observation),
            socket=socket,
            **{name: int(getattr(pacing, name)) for name in ("period", "lockstep", "may_write", "watchdog", "release")},
            **{name: Pair(*getattr(pacing, name)) for name in ("safe", "largest", "brake", "lower", "upper")},
            **{name: getattr(pacing, name) for name in ("position", "speed")},
            reference=Triple(*pacing.reference),
            share=Pair(1.0, 1.0),
            bins=len(self.lateness),
            oldest=pacing.oldest,
        )

    def serve(self) -> None:
        """Run until the end, or until ``shared.quit`` is set, without the global interpreter lock."""
        self._library.serve(ctypes.addressof(self.shared))

    @property
    def counts(self) -> Mapping[str, int]:
        """Name → count of events."""
        names = "silences", "ticks", "missed", "accepted", "refused", "not_allowed"
        return {name: getattr(self.shared, name) for name in names}


@cache
def _library() -> ctypes.CDLL:
    driver = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
    return code_cache.loaded(translation_unit.unit(POSIX, (), driver), compilers.find_compiler(), serve="n")
