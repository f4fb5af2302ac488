"""Recordings: columns of CSV and Parquet files, or lists of numbers, over time, in stated units.

A file is read once and kept, as the content of a signal or a reference. Errors name file and line or row.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.csv_files import TableColumn, named_columns, read_csv, split_header
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import NONE, Numbers, unknown
from dualwinch.model.units import factor

KEPT_FILES = 32
"""Number of cached files: the scenarios of an ensemble may read the same few files in turn."""

SINCE_1970 = 3e8
"""Times in s from here on are dates, not times since the start of a run."""


def read_table(file: str, names: tuple[str | None, ...]) -> list[TableColumn]:
    """Some columns of a CSV (`model.csv_files`) or Parquet file, with finite numbers in every row.

    Cached until the file changes. A name of ``None`` stands for the only remaining column.

    Raises:
        ConfigurationError: the file cannot be read, lacks a column, has fewer than two rows, or a cell of these
            columns is no finite number.
    """
    path = Path(file)
    if path.suffix.lower() not in READERS:
        raise ConfigurationError(f"{file}: unknown suffix {path.suffix!r}; must be {' or '.join(READERS)}")
    try:
        stamp = path.stat()
        return _read(file, names, stamp.st_mtime_ns, stamp.st_size)
    except OSError as error:
        raise ConfigurationError(f"cannot read {file}: {error.strerror or error}") from error


@lru_cache(maxsize=KEPT_FILES)
def _read(file: str, names: tuple[str | None, ...], changed: int, size: int) -> list[TableColumn]:  # noqa: ARG001
    path = Path(file)
    columns = chosen(path, names, READERS[path.suffix.lower()](path))
    for column in columns:
        if column.content:
            raise ConfigurationError(f"{path}: column '{column.name}' is of type {column.content}: must be numbers")
        if column.other_unit:
            raise ConfigurationError(f"{path}: {column.contradiction}")
    wrong = np.isnan([column.values for column in columns])
    if wrong.any():
        row = int(wrong.any(axis=0).argmax())
        column = columns[int(wrong[:, row].argmax())]
        cell = (column.cells[row].strip()[:40] or "nothing") if len(column.cells) else "nan"
        raise ConfigurationError(f"{path}: {column.place(row)}: {column.name} = {cell}: must be a finite number")
    if wrong.shape[1] < 2:
        raise ConfigurationError(f"{file}: is too short: must have two rows of numbers or more, not {wrong.shape[1]}")
    return columns


TIMES, OTHER_TIMES = "t", "time"
"""Usual name of the column of the times, and the one that stands for it in a file without that."""


def chosen(file: Path, names: Sequence[str | None], table: Sequence[TableColumn]) -> list[TableColumn]:
    """The columns by header or name; ``None`` stands for the only remaining one."""
    named = {name: _named(file, name, table) for name in names if name is not None}
    unnamed = [column for column in table if not any(column is each for each in named.values())]
    if None in names and len(unnamed) != 1:
        listed = ", ".join(column.name for column in unnamed[:6]) + (", ..." if len(unnamed) > 6 else "")
        raise ConfigurationError(f"{file}: column: must be named; there is {listed or 'none but the times'}")
    return [unnamed[0] if name is None else named[name] for name in names]


def _named(file: Path, name: str, table: Sequence[TableColumn]) -> TableColumn:
    columns = named_columns(table, name) or (named_columns(table, OTHER_TIMES) if name == TIMES else [])
    if not columns:
        every = [column.name for column in table if column.name]
        spellings = [column for column in every if column.lower() == name.lower()]
        raise ConfigurationError(f"{file}: {unknown('column', name, spellings or every)}")
    if len(columns) > 1:
        headers = list(dict.fromkeys(column.header for column in columns))
        which = f"; name one: {', '.join(headers)}" if len(headers) > 1 else ""
        raise ConfigurationError(f"{file}: has more than one column '{name}'{which}")
    return columns[0]


def read_parquet(path: Path) -> list[TableColumn]:
    """Read all columns of a Parquet file; units from its metadata, else from the column names.

    Raises:
        ConfigurationError: it is no Parquet file.
        OSError: it cannot be read.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with path.open("rb") as file:
            columns, table = list[TableColumn](), parquet.read_table(file)
    except pa.ArrowInvalid as error:
        raise ConfigurationError(f"{path}: not a Parquet file: {str(error).splitlines()[0]}") from error
    for field, values in zip(table.schema, table.columns, strict=True):
        unit, stamps = (field.metadata or {}).get(b"unit", b"").decode(), pa.types.is_timestamp(field.type)
        name, header_unit = (field.name, unit) if unit else split_header(field.name)
        if stamps:
            values = values.cast(pa.timestamp("ns", field.type.tz)).cast(pa.int64())  # noqa: PLW2901
        elif pa.types.is_duration(field.type):
            values, unit = values.cast(pa.duration("ns")).cast(pa.int64()), "ns"  # noqa: PLW2901
            columns.append(TableColumn.of_numbers(field.name, field.name, unit, np.array(values.to_numpy(), float)))
            continue
        elif not (pa.types.is_integer(field.type) or pa.types.is_floating(field.type)):
            columns.append(TableColumn(field.name, name, header_unit, np.zeros(0), content=str(field.type)))
            continue
        numbers = np.array(values.to_numpy(), float) * (1e-9 if stamps else 1.0)
        columns.append(TableColumn.of_numbers(field.name, name, header_unit, numbers, stamps=stamps))
    return columns


READERS: dict[str, Callable[[Path], list[TableColumn]]] = {".csv": read_csv, ".parquet": read_parquet}
"""Suffix → reader."""


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Origin:
    """Source of a recording: columns of a file, or lists.

    Attributes:
        file: its path; ``None`` where the numbers are given.
        time_column, time_unit: column of the times and its unit; default: that of the file, else s.
        columns: names of the other columns; ``None`` stands for the only remaining one.
        times, values: the numbers, without a file.
    """

    file: str | None
    time_column: str
    time_unit: str | None
    columns: tuple[str | None, ...]
    times: Numbers = NONE
    values: Numbers = NONE


@dataclass(frozen=True, eq=False)
class Recording:
    """Numbers over time, as read.

    Attributes:
        origin: their source.
        t: (n,) times in s, ascending.
        columns: the other columns, each (n,), in their original units.
        names: names of the columns; ``values`` for a list.
        units: units of the columns, where the file states them.
        time_unit: unit of the times, where the origin or the file states it.
        digest: first 16 digits of the SHA-256 of times, columns and their units.
    """

    origin: Origin
    t: Floats
    columns: tuple[Floats, ...]
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    time_unit: str | None
    digest: str

    def column(self, index: int, unit: str | None, si: str) -> Floats:
        """A column by its number, in an SI unit, (n,); its original unit may be given, ``None``: as the file states.

        Raises:
            ConfigurationError: no unit, contradicting units, or a unit of another quantity.
        """
        unit_of_column = self.units[index]
        stated = unit_of_column if unit is None else unit
        about = f"{self.origin.file}: column '{self.names[index]}'" if self.origin.file else self.names[index]
        if stated is None:
            raise ConfigurationError(f'{about}: has no unit; say which: unit = "{si}"')
        if unit_of_column is not None and stated != unit_of_column:
            raise ConfigurationError(f'{about}: unit "{stated}": must be "{unit_of_column}", as the file says')
        try:
            return factor(stated, si) * self.columns[index]
        except ConfigurationError as error:
            raise ConfigurationError(f"{about}: {error}") from error


def recorded(origin: Origin, kept: Recording | None, digest: str | None) -> Recording:
    """The recording of an origin: `kept` if it has this origin, else read now.

    `digest` is that of `kept`, or the expected one.

    Raises:
        ConfigurationError: the numbers cannot be read, or do not have the expected digest.
    """
    if kept is not None and kept.origin == origin:
        return kept
    read = _listed(origin) if origin.file is None else _of_file(origin, origin.file)
    expected = None if kept is not None and digest == kept.digest else digest
    if expected not in {None, read.digest}:
        raise ConfigurationError(
            f"{origin.file or 'values'}: has changed: its numbers have the digest {read.digest}, must be {expected}"
        )
    return read


def _of_file(origin: Origin, file: str) -> Recording:
    times, *columns = read_table(file, (origin.time_column, *origin.columns))
    try:
        t = times.factor("s", origin.time_unit) * times.values
    except ConfigurationError as error:
        raise ConfigurationError(f"{file}: {error}") from error
    _check_ascending(times.values, lambda row: f"{file}: {times.place(row)}: {times.name}")
    if times.stamps or t[0] >= SINCE_1970:
        raise ConfigurationError(f"{file}: {times.at(0)}: must be the time since the run began, in s or a stated unit")
    names, units = (tuple(getattr(column, what) for column in columns) for what in ("name", "unit"))
    return _recording(
        origin, t, tuple(column.values for column in columns), names, units, origin.time_unit or times.unit
    )


def _check_ascending(times: Floats, place: Callable[[int], str]) -> None:
    descents = np.flatnonzero(np.diff(times) <= 0)
    if len(descents):
        index = int(descents[0]) + 1
        before = f"must be > {times[index - 1]:.15g}, the time before it"
        raise ConfigurationError(f"{place(index)} = {times[index]:.15g}: {before}")


def _listed(origin: Origin) -> Recording:
    t, values = np.array(origin.times, float), np.array(origin.values, float)
    if len(t) != len(values):
        raise ConfigurationError(f"values: has {len(values)} numbers: must have {len(t)}, one for each of times")
    if len(t) < 2:
        raise ConfigurationError("times: is too short: must have two numbers or more")
    for name, numbers in (("times", t), ("values", values)):
        wrong = np.flatnonzero(~np.isfinite(numbers))
        if len(wrong):
            raise ConfigurationError(f"{name}[{wrong[0]}] = {numbers[wrong[0]]:g}: must be a finite number")
    _check_ascending(t, lambda index: f"times[{index}]")
    return _recording(origin, factor(origin.time_unit or "s", "s") * t, (values,), ("values",), (None,), "s")


def _recording(
    origin: Origin,
    t: Floats,
    columns: tuple[Floats, ...],
    names: tuple[str, ...],
    units: tuple[str | None, ...],
    time_unit: str | None,
) -> Recording:
    content = hashlib.sha256(repr(units).encode())
    for numbers in (t, *columns):
        numbers.flags.writeable = False
        content.update(np.ascontiguousarray(numbers, dtype="<f8").tobytes())
    return Recording(origin, t, columns, names, units, time_unit, content.hexdigest()[:16])
