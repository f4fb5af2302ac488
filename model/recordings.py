"""Recordings: columns of CSV and Parquet files, or lists of numbers, over the time, in named units.

A file is read once and kept: it is the content behind a signal or a reference. Errors name file and line or row.
"""

import csv
import difflib
import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import NONE, Numbers, unknown

UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "kn": 1852 / 3600},
    "m/s^2": {"m/s^2": 1.0, "mm/s^2": 1e-3, "cm/s^2": 1e-2},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6},
    "N m": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "kN m": 1e3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "Hz": 2 * math.pi},
}
"""SI unit → units it may be given in, each with its factor."""


def factor(unit: str, si: str) -> float:
    """What a number in a unit is multiplied by to be in an SI unit.

    Raises:
        ConfigurationError: the unit is not one of that quantity; the message lists those that are.
    """
    if unit not in UNITS[si]:
        listed = ", ".join(UNITS[si])
        alike = [known for known in UNITS[si] if known.lower() == unit.lower()]
        alike = alike or difflib.get_close_matches(unit, UNITS[si], n=1, cutoff=0.6)
        hint = f"; did you mean '{alike[0]}'?" if alike else ""
        raise ConfigurationError(f'unit "{unit}": must be one of {listed}{hint}')
    return UNITS[si][unit]


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
        file: ``.csv`` (a header of names, full stops as decimal points) or ``.parquet``.
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
    lines: list[int] = []
    rows: list[list[float]] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as text:
            reader = csv.reader(text)
            header = [name.strip() for name in next(reader, [])]
            wanted = chosen(path, names, header)
            indices = [header.index(name) for name in wanted]
            for cells in reader:
                if cells:
                    where = f"{path}: line {reader.line_num}"
                    if len(cells) != len(header):
                        raise ConfigurationError(f"{where}: has {len(cells)} cells: must have {len(header)}")
                    rows.append([_number(cells[index], header[index], where) for index in indices])
                    lines.append(reader.line_num)
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: not UTF-8 text (byte {error.start})") from error
    except csv.Error as error:
        raise ConfigurationError(f"{path}: not valid CSV: {error}") from error
    columns = np.array(rows, float).reshape(len(rows), len(wanted)).T
    units = csv_units(path)
    named = dict(zip(wanted, np.ascontiguousarray(columns), strict=True))
    return Table(named, {name: units[name] for name in wanted if name in units}, lines)


def _number(cell: str, name: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigurationError(f"{where}: {name} = {cell.strip()[:40] or 'nothing'}: must be a finite number")
    return value


def csv_units(path: Path) -> dict[str, str]:
    """Units of a CSV file, where `simulation.results.storage` has put its metadata beside it."""
    beside = path.with_name(path.name + "-metadata.json")
    if not beside.exists():
        return {}
    try:
        columns = json.loads(beside.read_text(encoding="utf-8"))["tableSchema"]["columns"]
        return {column["name"]: column["dualwinch:unit"] for column in columns if "dualwinch:unit" in column}
    except (ValueError, LookupError, TypeError):
        return {}  # metadata of another kind, which says nothing of units


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
