"""Logs: torque commands and sensor readings of a machine, of arrays and simulated runs."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.controllers.parts import Measurement
from dualwinch.identification.predictor import READINGS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import unknown
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.rows import READ

Floats = NDArray[np.float64]

TORQUES = ("tau_1", "tau_2")
"""Torque commands, which drive the prediction."""

POSITIONS = ("x", "theta_1", "theta_2")
"""Readings of which a log has at least one."""

UNIT_OF = {
    "t": "s",
    **dict.fromkeys(TORQUES, "N m"),
    **{name: describe(Measurement)[name].quantity.unit for name in READINGS},
}
"""Name → SI unit."""


@dataclass(frozen=True, eq=False)
class Log:
    """A log.

    Attributes:
        t: (n,) time of each row in s, ascending.
        columns: name → (n,) in SI units: torque commands ``tau_1``, ``tau_2`` at the motors, and some of
            `identification.predictor.READINGS`. NaN where nothing was recorded.
        name: of the log in messages.
        notes: what was noticed while it was read.
    """

    t: Floats
    columns: Mapping[str, Floats]
    name: str = "log"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            ConfigurationError: no rows, time that stands still or goes back, no torques, no position or encoder.
        """
        if len(self.t) < 2:
            raise self.refused(f"{self.name}: has {len(self.t)} rows: must be 2 or more")
        if not np.isfinite(self.t).all():
            raise ConfigurationError(f"{self.name}: t: must be a finite number in every row")
        backwards = np.flatnonzero(np.diff(self.t) <= 0)
        if len(backwards):
            row = int(backwards[0]) + 1
            raise ConfigurationError(
                f"{self.name}: t = {self.t[row]:.12g} s in row {row + 1} after {self.t[row - 1]:.12g} s: must ascend"
            )
        check_columns(self.name, self.columns)
        for name in TORQUES:
            if not np.isfinite(self.columns[name]).any():
                raise self.refused(f"{self.name}: {name}: has no value in any row, and torques drive the fit")

        if not set(POSITIONS) & set(self.readings):
            raise self.refused(
                f"{self.name}: {', '.join(each for each in POSITIONS if each in self.columns)}: has no value in "
                "any row: must have a position or an encoder"
            )

    def refused(self, words: str) -> ConfigurationError:
        """The error that refuses it, with what was noticed while it was read."""
        notes = "; ".join(note.removeprefix(f"{self.name}: ") for note in self.notes)
        return ConfigurationError(f"{words} (noticed: {notes})" if notes else words)

    @property
    def readings(self) -> tuple[str, ...]:
        """The sensors it has, in the order of `READINGS`."""
        return tuple(name for name in READINGS if name in self.columns and np.isfinite(self.columns[name]).any())

    @property
    def duration(self) -> float:
        """Time in s from the first row to the last."""
        return float(self.t[-1] - self.t[0])

    def split(self, share: float) -> tuple["Log", "Log"]:
        """All but a share of its duration at the end, and that."""
        early = self.t < self.t[0] + (1 - share) * (self.t[-1] - self.t[0])
        return self.rows(early), self.rows(~early)

    def rows(self, which: NDArray[np.bool_] | slice) -> "Log":
        """Some rows of it."""
        return replace(self, t=self.t[which], columns={name: each[which] for name, each in self.columns.items()})

    def from_zero(self) -> "Log":
        """The same, with the time since its first row."""
        return replace(self, t=self.t - self.t[0])

    def between_gaps(self, longest: float, least_rows: int) -> list["Log"]:
        """The log in parts, split where torques are missing for longer than `longest` seconds, or twice the usual step.

        Rows without torques are left out at the ends of a part, and so are parts of fewer than `least_rows`.

        Raises:
            ConfigurationError: no part is left.
        """
        longest = longest_step(self.t, longest)
        known = [np.flatnonzero(np.isfinite(self.columns[name])) for name in TORQUES]
        gaps = [(rows[at], rows[at + 1]) for rows in known for at in np.flatnonzero(np.diff(self.t[rows]) > longest)]
        first, last = max(rows[0] for rows in known), min(rows[-1] for rows in known)
        outside = [(0, first)] if self.t[first] - self.t[0] > longest else []
        outside += [(last, len(self.t) - 1)] if self.t[-1] - self.t[last] > longest else []
        if not gaps and not outside:
            return [self]
        inside = np.ones(len(self.t), bool)
        for before, after in gaps + outside:
            inside[before + 1 : after] = False
        begins = np.zeros(len(self.t), bool)
        begins[[after for _, after in gaps]] = True
        edges = np.flatnonzero(begins | (np.diff(inside.astype(int), prepend=0) != 0))
        parts = [slice(int(a), int(b)) for a, b in pairwise([*edges, len(self.t)]) if inside[a] and b - a >= least_rows]
        if not parts:
            raise ConfigurationError(
                f"{self.name}: {' and '.join(TORQUES)}: gaps of more than {longest:.3g} s leave no "
                f"{least_rows} rows in a row"
            )
        return [
            replace(self.rows(part), name=f"{self.name}, {self.t[part][0]:.4g} to {self.t[part][-1]:.4g} s")
            for part in parts
        ]


def longest_step(t: Floats, longest: float) -> float:
    """The longest step of the times t that is no gap: `longest` seconds, or twice the usual step."""
    return max(longest, 2 * float(np.median(np.diff(t))))


def log(columns: Mapping[str, ArrayLike], name: str = "log") -> Log:
    """A log of arrays: ``t`` in s, torque commands, and readings, all in SI units.

    Raises:
        ConfigurationError: an unknown column, columns of different lengths, or no log (`Log`).
    """
    for column in columns:
        if column not in UNIT_OF:
            raise ConfigurationError(f"{name}: {unknown('column', column, UNIT_OF)}")
    if "t" not in columns:
        raise ConfigurationError(f"{name}: must have a column t, times in s; it has {', '.join(columns) or 'none'}")
    arrays = {column: np.array(values, float) for column, values in columns.items()}
    for column, values in arrays.items():
        if values.shape != arrays["t"].shape or values.ndim != 1:
            raise ConfigurationError(f"{name}: {column}: must be a list of {arrays['t'].size} numbers, as t is")
    return Log(arrays.pop("t"), arrays, name)


def log_of(run: Result, name: str = "run") -> Log:
    """The log of a simulated run: its sensor readings where the run has them (``simulation.readings``), else the truth.

    Raises:
        ConfigurationError: the run has too few rows.
    """
    columns = run.columns
    read = {key: columns.get(f"{key}{READ}", columns.get(key)) for key in READINGS}
    arrays = {key: values for key, values in read.items() if values is not None}
    return Log(columns["t"], arrays | {key: columns[key] for key in TORQUES}, name)


def check_columns(source: str, found: Iterable[str], columns: Iterable[str] = (), required: Sequence[str] = ()) -> None:
    """Raise `ConfigurationError` where torques, a position or another required name was not found in a log.

    The message names the nearest of all columns of its file, if it is one, and all.
    """
    found, columns = list(found), list(columns)
    spare = {name.lower(): name for name in columns if name.removesuffix(READ) not in UNIT_OF}
    positions = [] if any(name in found for name in POSITIONS) else list(POSITIONS)
    missing = [name for name in (*required, *TORQUES) if name not in found] or positions
    if not missing:
        return
    words = "must have a position or an encoder: x, theta_1 or theta_2"
    words = words if missing == positions else f"{missing[0]}: no such column"
    hint = f"; name it with --column {missing[0]}=NAME; it has" if columns else "; it has"
    for name in missing if missing == positions else missing[:1]:
        near = difflib.get_close_matches(name.lower(), spare, n=1, cutoff=0.4)
        if near:
            hint = f"; did you mean '{spare[near[0]]}' (--column {name}={spare[near[0]]})? It has"
            break
    raise ConfigurationError(f"{source}: {words}{hint} {listed(columns or found)}")


def listed(columns: Iterable[str], most: int = 12) -> str:
    """Names of columns in a message, no more than so many."""
    names = list(columns)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
