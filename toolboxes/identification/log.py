"""Logs: torque commands and sensor readings of a machine, from arrays, simulated runs and files.

Files are CSV of any data logger, Parquet, MATLAB and NumPy; a map gives the column and unit of each reading.
"""

import difflib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias
from zipfile import is_zipfile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Result,
    csv_files,
    description,
    errors,
    physical_units,
    quantities,
    recordings,
    run_columns,
    sensing,
)
from dualwinch.toolboxes.identification.predictor import READINGS

Floats = NDArray[np.float64]
TableColumn: TypeAlias = csv_files.TableColumn

TORQUES = ("tau_1", "tau_2")
"""Torque commands, the inputs of the prediction."""

POSITIONS = ("x", "theta_1", "theta_2")
"""Readings of which a log needs at least one."""

UNIT_OF = {
    "t": "s",
    **dict.fromkeys(TORQUES, "N m"),
    **{name: description.describe(sensing.Measurement)[name].quantity.unit for name in READINGS},
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
        notes: from reading it.
    """

    t: Floats
    columns: Mapping[str, Floats]
    name: str = "log"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the log.

        Raises:
            ConfigurationError: no rows, times that do not ascend, no torques, no position or encoder.
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
        """The error that refuses the log, with its notes."""
        notes = "; ".join(note.removeprefix(f"{self.name}: ") for note in self.notes)
        return ConfigurationError(f"{words} (noticed: {notes})" if notes else words)

    @property
    def readings(self) -> tuple[str, ...]:
        """The recorded sensors, in the order of `READINGS`."""
        return tuple(name for name in READINGS if name in self.columns and np.isfinite(self.columns[name]).any())

    @property
    def duration(self) -> float:
        """Time in s from the first row to the last."""
        return float(self.t[-1] - self.t[0])

    def split(self, share: float) -> tuple["Log", "Log"]:
        """The log in two parts, the second with a share of its duration at the end."""
        before = self.t < self.t[0] + (1 - share) * (self.t[-1] - self.t[0])
        return self.rows(before), self.rows(~before)

    def rows(self, which: NDArray[np.bool_] | slice) -> "Log":
        """The log with the selected rows only."""
        return replace(self, t=self.t[which], columns={name: each[which] for name, each in self.columns.items()})

    def from_zero(self) -> "Log":
        """The log with times counted from its first row."""
        return replace(self, t=self.t - self.t[0])

    def between_gaps(self, max_gap: float, min_rows: int) -> list["Log"]:
        """The log in parts, split where torques are missing for longer than `max_gap` seconds, or twice the usual step.

        Rows without torques at the ends of a part are dropped, and so are parts of fewer than `min_rows`.

        Raises:
            ConfigurationError: no part is left.
        """
        max_gap = longest_step(self.t, max_gap)
        torque_rows = [np.flatnonzero(np.isfinite(self.columns[name])) for name in TORQUES]
        gaps = [
            (rows[at], rows[at + 1]) for rows in torque_rows for at in np.flatnonzero(np.diff(self.t[rows]) > max_gap)
        ]
        begin, end = max(rows[0] for rows in torque_rows), min(rows[-1] for rows in torque_rows)
        outside = [(0, begin)] if self.t[begin] - self.t[0] > max_gap else []
        outside += [(end, len(self.t) - 1)] if self.t[-1] - self.t[end] > max_gap else []
        if not gaps and not outside:
            return [self]
        inside = np.ones(len(self.t), bool)
        for before, after in gaps + outside:
            inside[before + 1 : after] = False
        begins = np.zeros(len(self.t), bool)
        begins[[after for _, after in gaps]] = True
        edges = np.flatnonzero(begins | (np.diff(inside.astype(int), prepend=0) != 0))
        parts = [slice(int(a), int(b)) for a, b in pairwise([*edges, len(self.t)]) if inside[a] and b - a >= min_rows]
        if not parts:
            raise ConfigurationError(
                f"{self.name}: {' and '.join(TORQUES)}: gaps of more than {max_gap:.3g} s leave no "
                f"{min_rows} rows in a row"
            )
        return [
            replace(self.rows(part), name=f"{self.name}, {self.t[part][0]:.4g} to {self.t[part][-1]:.4g} s")
            for part in parts
        ]


def gap_note(parts: Sequence[Log]) -> str:
    """Note on a log that `Log.between_gaps` has split."""
    gaps = ", ".join(f"{before.t[-1]:.4g} to {after.t[0]:.4g} s" for before, after in pairwise(parts))
    name = parts[0].name.rpartition(", ")[0]
    return f"{name}: no torques from {gaps}; fitted as {len(parts)} logs, as what happened between is unknown"


def longest_step(t: Floats, longest: float) -> float:
    """The longest step of the times t that is not a gap: `longest` seconds, or twice the usual step."""
    return max(longest, 2 * float(np.median(np.diff(t))))


def log(columns: Mapping[str, ArrayLike], name: str = "log") -> Log:
    """A log from arrays: ``t`` in s, torque commands, and readings, all in SI units.

    Raises:
        ConfigurationError: an unknown column, columns of different lengths, or an invalid log (`Log`).
    """
    for column in columns:
        if column not in UNIT_OF:
            raise ConfigurationError(f"{name}: {quantities.unknown('column', column, UNIT_OF)}")
    if "t" not in columns:
        raise ConfigurationError(f"{name}: must have a column t, times in s; it has {', '.join(columns) or 'none'}")
    arrays = {column: np.array(values, float) for column, values in columns.items()}
    for column, values in arrays.items():
        if values.shape != arrays["t"].shape or values.ndim != 1:
            raise ConfigurationError(f"{name}: {column}: must be a list of {arrays['t'].size} numbers, as t is")
    return Log(arrays.pop("t"), arrays, name)


def log_of(run: Result, name: str = "run") -> Log:
    """The log of a simulated run: its sensor readings (``simulation.readings``) or, without them, the true values.

    Raises:
        ConfigurationError: the run has too few rows.
    """
    columns = run.columns
    read = {key: columns.get(f"{key}{run_columns.READ}", columns.get(key)) for key in READINGS}
    arrays = {key: values for key, values in read.items() if values is not None}
    return Log(columns["t"], arrays | {key: columns[key] for key in TORQUES}, name)


def check_columns(source: str, names: Iterable[str], columns: Iterable[str] = (), required: Sequence[str] = ()) -> None:
    """Raise `ConfigurationError` if torques, a position or another required name is missing in a log.

    The message names the columns of its file, if it is from one, and the nearest.
    """
    names, columns = list(names), list(columns)
    spare = {name.lower(): name for name in columns if name.removesuffix(run_columns.READ) not in UNIT_OF}
    positions = [] if any(name in names for name in POSITIONS) else list(POSITIONS)
    absent = [name for name in (*required, *TORQUES) if name not in names] or positions
    if not absent:
        return
    words = "must have a position or an encoder: x, theta_1 or theta_2"
    words = words if absent == positions else f"{absent[0]}: no such column"
    hint = f"; name it with --column {absent[0]}=NAME; it has" if columns else "; it has"
    if columns and all(name.isdecimal() for name in columns):
        hint = f"; the file has no header, name columns by number, --column {absent[0]}=1; it has"
    for name in absent if absent == positions else absent[:1]:
        near = difflib.get_close_matches(name.lower(), spare, n=1, cutoff=0.4)
        if near:
            hint = f"; did you mean '{spare[near[0]]}' (--column {name}={spare[near[0]]})? It has"
            break
    raise ConfigurationError(f"{source}: {words}{hint} {listed(columns or names)}")


def listed(columns: Iterable[str], most: int = 12) -> str:
    """Names of columns for a message, at most `most`."""
    names = list(columns)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


TIMES = ("t", "time", "Time", "TIME", "timestamp", "Timestamp", "timestamps", "__index_level_0__", "X_Value")
"""Names of the column of times."""

SAME_TIME = 1e-3
"""Share of the time step within which two times are equal, because unit conversion rounds them."""

LEAST_SPAN = 0.05
"""Least share of the torques' time span that a reading's own times must cover: else their unit is wrong."""

OMITTED = "-"
"""In place of a column's name: the reading is omitted."""

EPOCHS = {"s": (3e8, 1e10), "ms": (3e11, 1e13), "us": (3e14, 1e16), "ns": (3e17, 1e19)}
"""Unit → range of numbers that are taken as a time since 1970 in this unit (from 1979 on), if none is stated."""

TEXT, NUMBER = "text", "a single number"
"""Other contents of files."""

OTHER_CONTENTS = {"c": "complex", "b": "true or false", "U": TEXT, "S": TEXT, "O": "cells", "V": "complex"}
"""Kind of an array without real numbers → its content. MATLAB's cells are objects, complex numbers in HDF5 pairs."""

CONTENTS = ("data", "values", "Data", "Values", "signals")
"""Generic names of a MATLAB structure's fields; the column is named after the structure instead."""


def column_map(texts: str | Sequence[str]) -> dict[str, str]:
    """Reading → column, from texts such as ``F1=load cell left``, ``F1=left:kN``, ``F1=left@left_time:ms`` or ``F1=-``.

    Raises:
        ConfigurationError: an invalid text, an unknown reading, or two columns for one.
    """
    columns = dict[str, str]()
    for text in [texts] if isinstance(texts, str) else texts:
        parts = re.fullmatch(r"\s*(\w+)\s*=\s*(\S.*?)\s*", text)
        if not parts:
            raise ConfigurationError(f"--column {text}: must be READING=COLUMN or READING=COLUMN:UNIT, e.g. F1=left:kN")
        if parts[1] not in UNIT_OF:
            raise ConfigurationError(f"--column {text}: {quantities.unknown('reading', parts[1], UNIT_OF)}")
        if columns.get(parts[1], parts[2]) != parts[2]:
            raise ConfigurationError(f"--column {text}: {parts[1]} is {columns[parts[1]]} already: must be given once")
        columns[parts[1]] = parts[2]
    return columns


def read_log(file: str | PathLike[str], columns: Mapping[str, str] | None = None, csv: str = "") -> Log:
    """Read a log from a file: CSV, possibly compressed by gzip, Parquet, MATLAB or NumPy.

    1. Find columns by the names of readings (``x``, ``F1``, ...), or by these with ``_read``, as in runs with
       ``simulation.readings``; and units by a header ``F1 [kN]``, a row of units or metadata.
    2. Convert time stamps (ISO 8601) and times since 1970 in s, ms, µs or ns to seconds.
    3. Merge columns that have their own times.

    Args:
        file: its path.
        columns: reading → its column (`column_map`), by its name or its number from 1, if it has another name, another
            unit or its own times; for ``t`` also a fixed step, such as ``1ms`` or ``500Hz``, or a sum ``sec+nanosec``.
        csv: separator and decimal mark of a CSV file, such as ``;,``; default: detected.

    Raises:
        ConfigurationError: the file cannot be read, lacks a named column, or is an invalid log (`Log`).
    """
    path, columns = Path(file), columns or {}
    table = read_columns(path, csv)
    if computed_times := _computed_times(columns.get("t", ""), table, path):
        table, columns = [*table, computed_times], {**columns, "t": computed_times.header}
    readings = _log_columns(table, columns, path)
    check_columns(str(path), readings, [each.header for each in table if not each.content], ("t",))
    notes = [f"{path.name}: line {table[0].cut}: is incomplete, left out"] if table[0].cut else list[str]()
    values = {reading: _in_si(reading, each, path, notes) for reading, each in readings.items()}
    times = {
        reading: _own_times(table, each, readings["t"]) or readings["t"].column for reading, each in readings.items()
    }
    used = {id(each.column): (reading, each.column) for reading, each in readings.items()}
    used |= {id(column): ("t", column) for column in times.values()}
    summed = [part.strip().partition(":")[0] for part in readings["t"].column.header.split("+")]
    for reading, column in used.values():
        notes += _without_number(reading, column, path, csv)
    notes += _unused(
        path.name, [each for each in table if id(each) not in used and each.header not in summed], readings
    )
    seconds: dict[tuple[int, str | None], Floats] = {(id(times["t"]), None): values["t"]}
    for reading, column in times.items():
        which = id(column), readings[reading].times_unit
        seconds[which] = seconds[which] if which in seconds else _seconds(column, path, which[1])
        _check_ascending(column, seconds[which], path)
    times_of = {reading: seconds[id(column), readings[reading].times_unit] for reading, column in times.items()}
    _check_times(path, readings, values, times, times_of)
    merged = _merged(values, times_of)
    return Log(merged.pop("t"), merged, path.name, tuple(notes))


FIXED = r"([\d.]+(?:[eE][+-]?\d+)?)\s*(s|ms|us|µs|Hz|kHz)"
"""A sample time or a rate in place of a column of times."""


def _computed_times(text: str, table: Sequence[TableColumn], path: Path) -> TableColumn | None:
    """Times that are no column of the file: at a fixed step, such as ``1ms`` or ``500Hz``, or a sum ``sec+nanosec``.

    Columns of a sum are in s where no unit is stated, or in ns if their names say ``nano`` or ``nsec``.

    Raises:
        ConfigurationError: a column of the sum is unknown.
    """
    if not text or _column(table, text, path):
        return None
    rows = max((len(each.values) for each in table), default=0)
    if parts := re.fullmatch(FIXED, text.strip()):
        value, unit = float(parts[1]), parts[2]
        step: float = 1 / (value * (1e3 if unit == "kHz" else 1.0)) if unit.endswith("Hz") else value
        step *= 1.0 if unit.endswith("Hz") else physical_units.factor(unit, "s")
        times = np.array(step * np.arange(rows), np.float64)
        return TableColumn.of_numbers(text, text, "s", times)
    if "+" not in text:
        return None
    seconds: Floats = np.zeros(rows)
    for part in text.split("+"):
        column, unit, *_ = _named(table, part.strip(), path)
        short = "ns" if re.search(r"nano|nsec|_ns$", column.header, re.IGNORECASE) else "s"
        seconds = seconds + column.values * physical_units.factor(unit or column.unit or short, "s")
    return TableColumn.of_numbers(text, text, "s", seconds)


class LogColumn(NamedTuple):
    """The column of a reading, its named unit, the column of its own times, and their named unit."""

    column: TableColumn
    unit: str | None = None
    times: TableColumn | None = None
    times_unit: str | None = None


def _without_number(reading: str, column: TableColumn, path: Path, csv: str) -> Iterator[str]:
    """A note on rows with neither a finite number nor a gap.

    Raises:
        ConfigurationError: most rows are such.
    """
    filled, count = int(np.isfinite(column.values).sum()), len(column.words)
    if 2 * count > filled + count:
        forms = f"a number, a time stamp as {csv_files.STAMPS}," if reading == "t" else "a number"
        marks = "; --csv SEPARATOR+MARK, e.g. ';,', says the decimal mark"
        if csv:
            marks = f"; its marks are not those of --csv {csv}"
        hint = marks if len(column.cells) and csv_files.has_other_mark(column.cells[column.words[0]]) else ""
        raise ConfigurationError(f"{path.name}: {column.at(column.words[0])}: must be {forms} or a gap{hint}")
    if count:
        remainder = f", and so {'is 1 other' if count == 2 else f'are {count - 1} others'}" if count > 1 else ""
        what = "is neither a number nor a usual word for a gap, " if len(column.cells) else ""
        yield f"{path.name}: {column.at(column.words[0])}: {what}taken for a gap{remainder}"
    elif not filled and len(column.values):
        yield f"{path.name}: {column.header}: has no number in any row, not used"


def _log_columns(table: Sequence[TableColumn], columns: Mapping[str, str], path: Path) -> dict[str, LogColumn]:
    """Reading → its column, as named or by the reading's name; unnamed times default to those of ``tau_1``."""
    readings = dict[str, LogColumn]()
    for reading in UNIT_OF:
        if reading in columns:
            if columns[reading] != OMITTED:
                readings[reading] = _named(table, columns[reading], path)
            continue
        column = next(
            (each for name in (f"{reading}{run_columns.READ}", reading) if (each := _column(table, name, path))), None
        )
        if column and not _is_other(column, reading):
            readings[reading] = LogColumn(column)
    if "t" not in columns and "t" not in readings:
        times = [each for each in table if each.name in TIMES]
        if times_of_torque := _own_times(table, readings["tau_1"], None) if "tau_1" in readings else None:
            readings["t"] = LogColumn(times_of_torque)
        elif len(times) == 1:
            readings["t"] = LogColumn(times[0])
    return readings


def _is_other(column: TableColumn, reading: str) -> bool:
    """Whether the end of a name, such as ``x_d``, looks like a unit but not one of the reading."""
    ends = f"{column.name}_{column.unit}" == column.header.rpartition(".")[2]
    return ends and column.unit is not None and not physical_units.is_unit(column.unit, UNIT_OF[reading])


def _column(table: Sequence[TableColumn], name: str, path: Path) -> TableColumn | None:
    """The column with a given header or name, or ``None``."""
    columns = csv_files.named_columns([each for each in table if not each.content], name) or csv_files.named_columns(
        table, name
    )
    if len(columns) > 1:
        headers = dict.fromkeys(each.header for each in columns)
        which = f"; name one, --column READING=COLUMN: {listed(headers)}" if len(headers) > 1 else ""
        raise ConfigurationError(f"{path}: has more than one column '{name}'{which}")
    if columns and columns[0].content:
        reading = name.removesuffix(run_columns.READ)
        out = f", or left out (--column {reading}=-)" if reading in READINGS else ""
        raise ConfigurationError(
            f"{path}: column '{columns[0].header}': is {columns[0].content}: must be real numbers{out}"
        )
    return columns[0] if columns else None


def _named(table: Sequence[TableColumn], text: str, path: Path) -> LogColumn:
    """The column of a text ``COLUMN``, ``COLUMN:UNIT`` or ``COLUMN:UNIT@TIMES:UNIT``; names may have colons."""
    if column := _column(table, text, path) or _numbered(table, text):
        return LogColumn(column)
    words, _, words_of_times = (part.strip() for part in text.rpartition("@"))
    (column, unit), (times, unit_of_times) = (_with_unit(table, each, path) for each in (words, words_of_times))
    if words and column and times:
        if unit_of_times is not None and not physical_units.is_unit(unit_of_times, "s"):
            raise ConfigurationError(
                f"{path}: unit \"{unit_of_times}\" of the times '{times.header}': must be one of "
                f"{', '.join(physical_units.UNITS['s'])}; the unit of '{column.header}' goes before the @"
            )
        return LogColumn(column, unit, times, unit_of_times)
    column, unit = _with_unit(table, text, path)
    if column:
        return LogColumn(column, unit)
    name, _, unit = (part.strip() for part in text.rpartition(":"))
    title = name if name and physical_units.is_unit(unit.removeprefix("-")) else text
    near = difflib.get_close_matches(title, [each.header for each in table], n=1, cutoff=0.6)
    hint = f"did you mean '{near[0]}'? It" if near else "it"
    raise ConfigurationError(f"{path}: unknown column '{title}'; {hint} has {listed(each.header for each in table)}")


def _with_unit(table: Sequence[TableColumn], text: str, path: Path) -> tuple[TableColumn | None, str | None]:
    """The column of a text ``COLUMN`` or ``COLUMN:UNIT``, and the unit."""
    if column := _column(table, text, path) or _numbered(table, text):
        return column, None
    name, _, unit = (part.strip() for part in text.rpartition(":"))
    return _column(table, name, path) or _numbered(table, name), unit


def _numbered(table: Sequence[TableColumn], text: str) -> TableColumn | None:
    """The column of a number from 1, for headers that nobody can type."""
    return table[int(text) - 1] if text.isdecimal() and 1 <= int(text) <= len(table) else None


def _in_si(reading: str, log_column: LogColumn, path: Path, notes: list[str]) -> Floats:
    """A reading in SI units; adds a note if the named unit differs from the file's."""
    column, unit = log_column.column, log_column.unit
    if column.stamps and reading != "t":
        raise ConfigurationError(f"{path}: column '{column.header}': has time stamps: must be real numbers")
    if unit and column.unit and not physical_units.is_same_unit(unit.removeprefix("-"), column.unit):
        notes.append(f"{path.name}: {column.header}: is read in {unit}, as --column says, not in {column.unit}")
    return (
        _seconds(column, path, unit)
        if reading == "t"
        else column.values * _factor(column, UNIT_OF[reading], unit, path)
    )


def _factor(column: TableColumn, si: str, unit: str | None, path: Path) -> float:
    try:
        return column.factor(si, unit)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None


def _seconds(column: TableColumn, path: Path, unit: str | None = None) -> Floats:
    """Times in s, from time stamps, times since 1970, or times in a given unit."""
    if column.stamps:
        if unit:
            raise ConfigurationError(
                f"{path}: column '{column.header}': has time stamps: must be without a unit, not {unit}"
            )
        return column.values
    stated, start = unit or column.unit, float(column.values[np.isfinite(column.values)][:1].sum())
    if stated is None:
        unit = next((name for name, (low, high) in EPOCHS.items() if low <= start < high), "s")
    return column.values * _factor(column, "s", unit, path)


def _own_times(table: Sequence[TableColumn], log_column: LogColumn, t: LogColumn | None) -> TableColumn | None:
    """The column of a reading's own times: as named, named after the reading, or next to it in a structure."""
    if log_column.times or log_column is t:
        return log_column.times
    name, (*places, _) = log_column.column.name, log_column.column.header.split(".")
    within = [".".join(places[:count]) for count in range(len(places), 0, -1)]
    forms = [form for each in TIMES for form in (f"{each}_{name}", f"{name}_{each}")]
    forms += [f"{place}.{each}" for place in within for each in TIMES]
    spare = [each for each in table if not t or each is not t.column]
    named = [each for form in forms for each in spare if form in {each.header, each.name}]
    return next((each for each in named if len(each.values) == len(log_column.column.values)), None)


def _check_ascending(column: TableColumn, seconds: Floats, path: Path) -> None:
    rows = np.flatnonzero(np.isfinite(seconds))
    steps = np.diff(seconds[rows])
    descents = np.flatnonzero(steps <= 0)
    if not len(descents):
        return
    before, row = (int(rows[descents[0] + offset]) for offset in (0, 1))
    back, repeats = -steps[descents[0]], int((steps == 0).sum())
    hint = f"goes back by {back:.6g} s" if back else f"{repeats} of {len(rows)} times repeat the one before"
    raise ConfigurationError(f"{path}: {column.at(row)}: must be later than {column.at(before)}; {hint}")


def _check_times(
    path: Path,
    readings: Mapping[str, LogColumn],
    values: Mapping[str, Floats],
    times: Mapping[str, TableColumn],
    times_of: Mapping[str, Floats],
) -> None:
    """Refuse readings that mostly have no time, or times outside those of the torques.

    Raises:
        ConfigurationError: a reading and its times differ in length, or its times are implausible.
    """
    of_torques = times_of["tau_1"][np.isfinite(times_of["tau_1"])]
    for reading, at in times_of.items():
        read, column, header = values[reading], readings[reading].column.header, times[reading].header
        name = f"name its own times: --column '{reading}={column}@TIMES'"
        if len(at) != len(read):
            raise ConfigurationError(
                f"{path}: {reading} has {len(read)} values and its times {len(at)}: must be as many; {name}"
            )
        filled = np.isfinite(read)
        timed = filled & np.isfinite(at)
        if 2 * timed.sum() < filled.sum():
            raise ConfigurationError(
                f"{path}: {reading} has {filled.sum()} values, {timed.sum()} with a time in {header}; {name}"
            )
        count = int(filled.sum())
        first_rows = count < len(at) and filled[:count].all() and 2 * count <= np.isfinite(at).sum() + 1
        if count and first_rows and readings[reading].times is None and times[reading] is readings["t"].column:
            raise ConfigurationError(
                f"{path}: {reading} has values in the first {count} of {len(at)} rows alone: is it of a lower rate? "
                f"{name}; or, if {header} is right: --column '{reading}={column}@{header}'"
            )
        if at is times_of["tau_1"] or not timed.any() or not len(of_torques):
            continue
        (begin, finish), (start, end) = at[timed][[0, -1]], of_torques[[0, -1]]
        within = (at[timed] >= start) & (at[timed] <= end)
        if 2 * within.sum() < len(within) or finish - begin < LEAST_SPAN * (end - start):
            raise ConfigurationError(
                f"{path}: {reading}: has times {begin:.10g} to {finish:.10g} s in {header}, tau_1 {start:.10g} to "
                f"{end:.10g} s: must be of one origin, zone and unit (--column '{reading}={column}@{header}:UNIT')"
            )


def _merged(values: Mapping[str, Floats], times_of: Mapping[str, Floats]) -> dict[str, Floats]:
    """All readings over a common time: that of the log, and the times of columns that have their own."""
    if all(times is values["t"] for times in times_of.values()):
        filled = np.isfinite(values["t"])
        return {reading: each[filled] for reading, each in values.items()}
    t = values["t"][np.isfinite(values["t"])]
    rounded = {reading: _rounded_to(t, times) if len(t) > 1 else times for reading, times in times_of.items()}
    t = np.unique(np.concatenate([times[np.isfinite(times)] for times in rounded.values()]))
    merged = {"t": t}
    for reading, times in rounded.items():
        if reading != "t":
            filled = np.isfinite(times)
            merged[reading] = np.full(len(t), np.nan)
            merged[reading][np.searchsorted(t, times[filled])] = values[reading][filled]
    return merged


def _rounded_to(t: Floats, times: Floats) -> Floats:
    """Times, rounded to those of t where they are equal within `SAME_TIME`."""
    right = np.searchsorted(t, times).clip(1, len(t) - 1)
    nearest = np.where(times - t[right - 1] < t[right] - times, t[right - 1], t[right])
    return np.where(np.abs(times - nearest) < SAME_TIME * np.median(np.diff(t)), nearest, times)


def _unused(source: str, spare: Sequence[TableColumn], readings: Mapping[str, LogColumn]) -> Iterator[str]:
    """A note on unused columns, each with the option to use it."""
    spare = [each for each in spare if each.header and each.name.removesuffix(run_columns.READ) not in readings]
    absent = [reading for reading in UNIT_OF if reading not in readings]
    words = []
    for column in spare:
        if column.content in {TEXT, NUMBER}:
            continue
        if column.content:
            words.append(f"{column.header} ({column.content})")
            continue
        near = difflib.get_close_matches(column.name.lower(), [name.lower() for name in absent], n=1, cutoff=0.5)
        likely = [name for name in absent if name.lower() in near]
        likely += [name for name in absent if column.unit and physical_units.is_unit(column.unit, UNIT_OF[name])]
        words.append(f"{column.header} (--column '{likely[0]}={column.header}')" if likely else column.header)
    if words:
        how = "" if any("--column" in each for each in words) else "; --column READING=NAME uses one"
        yield f"{source}: not used: {listed(words)}{how}"


def read_columns(path: Path, csv: str = "") -> list[TableColumn]:
    """Read all columns of a file.

    Raises:
        ConfigurationError: an unknown suffix, or a file that cannot be read.
    """
    suffix = path.with_suffix("").suffix if path.suffix.lower() == ".gz" else path.suffix
    if suffix.lower() not in (*CSV_SUFFIXES, *READERS):
        raise ConfigurationError(f"{path}: unknown suffix {suffix!r}; must be {', '.join((*CSV_SUFFIXES, *READERS))}")
    try:
        return csv_files.read_csv(path, csv) if suffix.lower() in CSV_SUFFIXES else READERS[suffix.lower()](path)
    except ConfigurationError:
        raise
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, LookupError, TypeError, NotImplementedError, EOFError) as error:
        raise ConfigurationError(f"{path}: not a {suffix} file: {str(error).splitlines()[0][:200]}") from error


def _numpy(path: Path) -> list[TableColumn]:
    if not is_zipfile(path):
        raise ConfigurationError(f"{path}: not a .npz file")
    with np.load(path, allow_pickle=False) as arrays:
        tree = dict[str, Any]()
        for name in arrays.files:
            try:
                tree[name] = arrays[name]
            except ValueError:  # an array of Python objects
                tree[name] = np.zeros(1, object)
    if "units" in tree:
        try:
            units = json.loads(str(tree["units"]))
        except ValueError:
            units = None
        if not isinstance(units, Mapping):
            raise ConfigurationError(f'{path}: units: must be a JSON object of columns and units, e.g. {{"F1": "kN"}}')
        tree["units"] = units
    return _of_tree(tree)


def _matlab(path: Path) -> list[TableColumn]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError, matfile_version

    if path.read_bytes()[:100].startswith(b"# Created by Octave"):
        raise ConfigurationError(f"{path}: is of Octave's text format: save it with save -v7")
    try:
        is_hdf5 = matfile_version(path, appendmat=False)[0] == 2
    except MatReadError as error:
        raise ConfigurationError(f"{path}: not a .mat file: {error}") from error
    arrays = _matlab_7_3(path) if is_hdf5 else loadmat(path, simplify_cells=True)
    return _of_tree({name: each for name, each in arrays.items() if not name.startswith("__")})


def _matlab_7_3(path: Path) -> dict[str, Any]:
    """Groups and arrays of a file of version 7.3, which is in HDF5."""
    try:
        h5py: Any = import_module("h5py")
    except ImportError:
        raise ConfigurationError(
            f"{path}: is of MATLAB's version 7.3: {errors.installing('matlab')}, or save it with save(..., '-v7')"
        ) from None

    def tree(group: Any) -> dict[str, Any]:
        # no external links
        names = [name for name in group if isinstance(group.get(name, getlink=True), h5py.HardLink)]
        items = {name: group[name] for name in names if not name.startswith("#")}
        return {name: array(each) if isinstance(each, h5py.Dataset) else tree(each) for name, each in items.items()}

    def array(dataset: Any) -> Any:
        if dataset.attrs.get("MATLAB_class") == b"char":
            return "".join(map(chr, np.ravel(dataset[()])))
        return np.zeros(0) if "MATLAB_empty" in dataset.attrs else np.transpose(dataset[()])

    with h5py.File(path, "r") as file:
        return tree(file)


def _of_tree(tree: Mapping[str, Any], within: str = "", unit: str | None = None) -> list[TableColumn]:
    """Columns of nested arrays: ``rig.F1`` of a structure, ``rig.F.1`` of a matrix, named by the last part.

    A field ``units`` is their common unit, except for times, or has a unit for each name.
    """
    table, stated = list[TableColumn](), tree.get("units")
    units = {name: str(each) for name, each in stated.items() if each} if isinstance(stated, Mapping) else {}
    unit = stated if isinstance(stated, str) else unit
    for key, item in tree.items():
        header, unit_of_key = f"{within}{key}", units.get(key, None if key in TIMES else unit)
        parts = _parts(item)
        if key == "units" and not np.issubdtype(np.asarray(item).dtype, np.number):
            if not isinstance(stated, Mapping | str):
                table.append(_without_numbers(header, "must be a text, or a structure of texts by the columns' names"))
            continue
        if parts is not None:
            table += _of_tree(parts, f"{header}.", unit_of_key)
            continue
        array = np.squeeze(item.toarray() if hasattr(item, "toarray") else item)  # a sparse matrix
        if content := _content(array):
            table.append(_without_numbers(header, content))
            continue
        columns = {header: array} if array.ndim == 1 else {f"{header}.{k}": p for k, p in enumerate(array.T, start=1)}
        for head, numbers in columns.items():
            name, of_name = _name(head)
            kind, values = numbers.dtype.kind, numbers
            if kind in "Mm":  # dates and durations
                values = np.where(np.isnat(numbers), np.nan, 1e-9 * numbers.astype(f"{kind}8[ns]").astype(float))
            in_unit = "s" if kind == "m" else unit_of_key or of_name
            table.append(TableColumn.of_numbers(head, name, in_unit, np.array(values, float), stamps=kind == "M"))
    return table


def _without_numbers(header: str, content: str) -> TableColumn:
    """A column that cannot be a reading, with its content in place of real numbers."""
    return TableColumn(header, _name(header)[0], None, np.zeros(0), content=content)


def _parts(item: Any) -> Mapping[str, Any] | None:
    """The fields of a structure, a list or a structured array; ``None`` for anything else."""
    if isinstance(item, list):
        return {str(number): each for number, each in enumerate(item, start=1)}
    names = getattr(getattr(item, "dtype", None), "names", None)
    if names and names != ("real", "imag"):
        return {name: item[name] for name in names}
    return item if isinstance(item, Mapping) else None


def _content(array: NDArray[Any]) -> str:
    """The content of an array without columns of real numbers, in words; else empty."""
    kind = array.dtype.kind
    if kind not in "fiuMm":
        return OTHER_CONTENTS.get(kind, str(array.dtype))
    if array.size < 2:
        return NUMBER if array.size else "empty"
    return f"of {array.ndim} dimensions" if array.ndim > 2 else ""


def _name(header: str) -> tuple[str, str | None]:
    """The last part of a header that is not generic (`CONTENTS`), and its unit."""
    parts = header.split(".")
    while len(parts) > 1 and parts[-1] in CONTENTS:
        parts.pop()
    return csv_files.split_header(parts[-1])


CSV_SUFFIXES = (".csv", ".txt", ".tsv", ".lvm")
"""Suffixes of CSV files."""

READERS: dict[str, Callable[[Path], list[TableColumn]]] = {
    ".parquet": recordings.read_parquet,
    ".npz": _numpy,
    ".mat": _matlab,
}
"""Suffix → reader of other files."""
