"""Recordings: columns of CSV and Parquet files, or lists of numbers, over the time, in named units.

A file is read once and kept: it is the content behind a signal or a reference. Errors name file and line or row.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.csv_files import read_csv
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import NONE, Numbers, unknown
from dualwinch.model.units import factor

KEPT = 32
"""Latest readings that are kept: the scenarios of an ensemble may read the same few files in turn."""


class Table(NamedTuple):
    """Some columns of a file: by name (rows,) finite numbers, units where the file says them, and line of each row."""

    columns: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    lines: Sequence[int] | None


def read_table(file: str, names: tuple[str | None, ...]) -> Table:
    """Some columns of a file; kept until the file is another one.

    Args:
        file: ``.csv`` (`model.csv_files`) or ``.parquet``.
        names: of the columns; ``None`` is the only one that is none of the others.

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


@lru_cache(maxsize=KEPT)
def _read(file: str, names: tuple[str | None, ...], changed: int, size: int) -> Table:  # noqa: ARG001
    path = Path(file)
    table = READERS[path.suffix.lower()](path, names)
    rows = len(next(iter(table.columns.values())))
    if rows < 2:
        raise ConfigurationError(f"{file}: is too short: must have two rows of numbers or more, not {rows}")
    return table


def chosen(file: Path, names: Sequence[str | None], header: Sequence[str]) -> list[str]:
    """The names of the columns to be read, of those that a file has, each once and, but for the only one, named."""
    found = []
    for name in names:
        others = [column for column in header if column not in names]
        if name is None and len(others) != 1:
            listed = ", ".join(others[:6]) + (", ..." if len(others) > 6 else "")
            raise ConfigurationError(f"{file}: column: must be named; there is {listed or 'none but the times'}")
        if name is not None and name not in header:
            alike = [column for column in header if column.lower() == name.lower()]
            raise ConfigurationError(f"{file}: {unknown('column', name, alike or filter(None, header))}")
        column = others[0] if name is None else name
        if list(header).count(column) > 1:
            raise ConfigurationError(f"{file}: has more than one column '{column}'")
        found.append(column)
    return found


def _read_csv(path: Path, names: tuple[str | None, ...]) -> Table:
    table = read_csv(path)
    headers = {column.header: column.name for column in table}
    wanted = chosen(path, [name and headers.get(name, name) for name in names], [column.name for column in table])
    columns = [next(column for column in table if column.name == name) for name in wanted]
    wrong = np.isnan([column.values for column in columns])
    if wrong.any():
        row = int(wrong.any(axis=0).argmax())
        column = columns[int(wrong[:, row].argmax())]
        cell = column.cells[row].strip()[:40] or "nothing"
        raise ConfigurationError(f"{path}: line {column.lines[row]}: {column.name} = {cell}: must be a finite number")
    named = {column.name: np.ascontiguousarray(column.values) for column in columns}
    return Table(named, {each.name: each.unit for each in columns if each.unit}, table[0].lines)


def _read_parquet(path: Path, names: tuple[str | None, ...]) -> Table:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        schema = parquet.read_schema(path)
        wanted = chosen(path, names, schema.names)
        table = parquet.read_table(path, columns=wanted)
    except pa.ArrowInvalid as error:
        raise ConfigurationError(f"{path}: not a Parquet file: {str(error).splitlines()[0]}") from error
    columns = {name: _column(table.column(name), name, path) for name in wanted}
    units = parquet_units(schema)
    return Table(columns, {name: units[name] for name in wanted if name in units}, None)


def parquet_units(schema: Any) -> dict[str, str]:
    """Units of the columns of a Parquet file that have one."""
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in schema}
    return {name: unit for name, unit in units.items() if unit}


def _column(column: Any, name: str, path: Path) -> NDArray[np.float64]:
    import pyarrow as pa

    kind = column.type
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        raise ConfigurationError(f"{path}: column '{name}' is of type {kind}: must be numbers")
    values = np.asarray(column.to_numpy(), float)
    wrong = ~np.isfinite(values)
    if wrong.any():
        row = int(wrong.argmax())
        raise ConfigurationError(f"{path}: row {row + 1}: {name} = {values[row]:g}: must be a finite number")
    return values


READERS = {".csv": _read_csv, ".parquet": _read_parquet}
"""Suffix → what reads it."""


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Origin:
    """Where numbers over the time come from: columns of a file, or lists.

    Attributes:
        file: its path; ``None`` where the numbers are given.
        time_column, time_unit: the column of the times; without a unit of its own or of the file, in s.
        columns: names of the others; ``None`` is the only one there is beside the named ones.
        times, values: the numbers, where there is no file.
    """

    file: str | None
    time_column: str
    time_unit: str | None
    columns: tuple[str | None, ...]
    times: Numbers = NONE
    values: Numbers = NONE


@dataclass(frozen=True, eq=False)
class Recording:
    """Numbers over the time, as they were read.

    Attributes:
        origin: where they come from.
        t: (n,) times in s, ascending.
        columns: the others, each (n,), in the units they came in.
        names: of the columns; ``values`` where they are a list.
        units: of the columns, where the file says them.
        digest: SHA-256 of all this but the origin, the first 16 digits.
    """

    origin: Origin
    t: Floats
    columns: tuple[Floats, ...]
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    digest: str

    def column(self, index: int, unit: str | None, si: str) -> Floats:
        """A column in an SI unit, (n,).

        Args:
            index: its number.
            unit: that it came in; ``None``: as the file says.
            si: the SI unit.

        Raises:
            ConfigurationError: no unit is stated, two different ones are, or it is of another quantity.
        """
        said = self.units[index]
        stated = said if unit is None else unit
        about = f"{self.origin.file}: column '{self.names[index]}'" if self.origin.file else self.names[index]
        if stated is None:
            raise ConfigurationError(f'{about}: has no unit; say which: unit = "{si}"')
        if said is not None and stated != said:
            raise ConfigurationError(f'{about}: unit "{stated}": must be "{said}", as the file says')
        try:
            return factor(stated, si) * self.columns[index]
        except ConfigurationError as error:
            raise ConfigurationError(f"{about}: {error}") from error


def recorded(origin: Origin, kept: Recording | None, digest: str | None) -> Recording:
    """The recording of an origin: the kept one where it is of this origin, else read now.

    The digest is that of the kept one, or of what is expected.

    Raises:
        ConfigurationError: the numbers cannot be read, or are not those expected.
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
    table = read_table(file, (origin.time_column, *origin.columns))
    names = tuple(name for name in table.columns if name != origin.time_column)
    unit = origin.time_unit or table.units.get(origin.time_column, "s")
    try:
        t = factor(unit, "s") * table.columns[origin.time_column]
    except ConfigurationError as error:
        raise ConfigurationError(f"{file}: column '{origin.time_column}': {error}") from error
    times, lines = table.columns[origin.time_column], table.lines
    _check_ascending(
        times,
        lambda row: f"{file}: {f'line {lines[row]}' if lines else f'row {row + 1}'}: {origin.time_column}",
    )
    return _recording(
        origin, t, tuple(table.columns[name] for name in names), names, tuple(map(table.units.get, names))
    )


def _check_ascending(times: Floats, place: Callable[[int], str]) -> None:
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        index = int(late[0]) + 1
        before = f"must be > {times[index - 1]:g}, the time before it"
        raise ConfigurationError(f"{place(index)} = {times[index]:g}: {before}")


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
    return _recording(origin, factor(origin.time_unit or "s", "s") * t, (values,), ("values",), (None,))


def _recording(
    origin: Origin, t: Floats, columns: tuple[Floats, ...], names: tuple[str, ...], units: tuple[str | None, ...]
) -> Recording:
    content = hashlib.sha256(repr(units).encode())
    for numbers in (t, *columns):
        numbers.flags.writeable = False
        content.update(np.ascontiguousarray(numbers, dtype="<f8").tobytes())
    return Recording(origin, t, columns, names, units, content.hexdigest()[:16])
