"""Columns of CSV and Parquet files, read with errors that name file and line or row."""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import nearest

KEPT = 32
"""Latest readings that are kept: the scenarios of an ensemble may read the same few files in turn."""


@dataclass(frozen=True, eq=False)
class Table:
    """Some columns of a file.

    Attributes:
        columns: name → (rows,) finite numbers.
        units: name → unit, where the file says it.
        lines: number of each row in the file, as an error names it.
        counted: what they count, ``line`` or ``row``.
    """

    columns: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    lines: Sequence[int]
    counted: str

    def position(self, row: int) -> str:
        """Where a row stands in the file."""
        return f"{self.counted} {self.lines[row]}"


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
    if len(table.lines) < 2:
        raise ConfigurationError(f"{file}: is too short: must have two rows of numbers or more, not {len(table.lines)}")
    return table


def chosen(file: Path, names: Sequence[str | None], header: Sequence[str]) -> list[str]:
    """The names of the columns to be read, of those that a file has.

    Raises:
        ConfigurationError: a column that the file lacks, has twice, or that is not named where there are several.
    """
    found = []
    for name in names:
        others = [column for column in header if column not in names]
        if name is None and len(others) != 1:
            listed = ", ".join(others[:6]) + (", ..." if len(others) > 6 else "")
            raise ConfigurationError(f"{file}: column: must be named; there is {listed or 'none but the times'}")
        if name is not None and name not in header:
            alike = [column for column in header if column.lower() == name.lower()]
            hint = f"; did you mean '{nearest(name, alike or header)}'?" if any(header) else "; it has none"
            raise ConfigurationError(f"{file}: unknown column '{name}'{hint}")
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
    return Table(named, {name: units[name] for name in wanted if name in units}, lines, "line")


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
    units = {name: (schema.field(name).metadata or {}).get(b"unit", b"").decode() for name in wanted}
    return Table(columns, {name: unit for name, unit in units.items() if unit}, range(1, table.num_rows + 1), "row")


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
