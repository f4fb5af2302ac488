"""Logs from files: CSV of any data logger, Parquet, MATLAB and NumPy; which column is which reading, in which unit."""

import difflib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.log import UNIT_OF, Log, check_columns, listed
from dualwinch.model.csv_files import TableColumn, read_csv
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.model.recordings import parquet_units
from dualwinch.model.units import factor, is_unit
from dualwinch.simulation.rows import READ

Floats = NDArray[np.float64]

TIMES = ("time", "Time", "TIME", "timestamp", "Timestamp")
"""Other names of the times."""

OMITTED = "-"
"""In the place of a column's name: the reading is left out."""

EPOCHS = {"s": (3e8, 1e10), "ms": (3e11, 1e13), "us": (3e14, 1e16), "ns": (3e17, 1e19)}
"""Unit of times without one → numbers that are the time since 1970 in it (from 1979 on), and no time of a run."""

OTHER_CONTENTS = {"c": "complex", "b": "true or false", "U": "texts", "S": "texts", "O": "cells", "V": "complex"}
"""Kind of an array without real numbers → its words. MATLAB's cells are objects, its complex numbers pairs in HDF5."""

CONTENTS = ("data", "values", "Data", "Values", "signals")
"""Last names of a MATLAB structure's fields that are named after what contains them."""


def column_map(texts: Sequence[str]) -> dict[str, str]:
    """Reading → column, from texts such as ``F1=load cell left``, ``F1=left:kN``, ``F1=left@left_time`` or ``F1=-``.

    Raises:
        ConfigurationError: another form, or an unknown reading.
    """
    found = {}
    for text in texts:
        parts = re.fullmatch(r"\s*(\w+)\s*=\s*(\S.*?)\s*", text)
        if not parts:
            raise ConfigurationError(f"--column {text}: must be READING=COLUMN or READING=COLUMN:UNIT, e.g. F1=left:kN")
        if parts[1] not in UNIT_OF:
            raise ConfigurationError(f"--column {text}: {unknown('reading', parts[1], UNIT_OF)}")
        found[parts[1]] = parts[2]
    return found


def read_log(file: str | PathLike[str], columns: Mapping[str, str] | None = None, csv: str = "") -> Log:
    """Read a log from a file: CSV, also packed by gzip, Parquet, MATLAB or NumPy.

    1. Columns are found by the names of readings (``x``, ``F1``, ...), or by these with ``_read``, as runs have them
       that were written with ``simulation.readings``; units by a header ``F1 [kN]``, a row of units or metadata.
    2. Time stamps (ISO 8601) and times since 1970 in s, ms, µs or ns become seconds.
    3. Columns with times of their own are put in their place between the others.

    Args:
        file: its path.
        columns: reading → its column (`column_map`), where that has another name, unit or times of its own.
        csv: separator and decimal mark of a CSV file, such as ``;,``; default: as the file shows.

    Raises:
        ConfigurationError: the file cannot be read, lacks a column that was named, or is no log (`Log`).
    """
    path, columns = Path(file), columns or {}
    table = read_columns(path, csv)
    chosen = _chosen(table, columns, path)
    check_columns(str(path), chosen, [each.header for each in table if not each.content], ("t",))
    notes, values = list[str](), {reading: _in_si(reading, each, path) for reading, each in chosen.items()}
    for reading, (column, *_) in chosen.items():
        if not len(column.words):
            continue
        row = column.words[0]
        word = f"{path.name}: line {column.lines[row]}: {column.header} = {column.cells[row].strip()[:40]!r}"
        if np.isnan(values[reading]).all():
            raise ConfigurationError(f"{word}: must be a number or a gap")
        more = f", and so are {len(column.words) - 1} others" if len(column.words) > 1 else ""
        notes.append(f"{word}: is neither a number nor a usual word for a gap, taken for a gap{more}")
    times = {reading: _own_times(table, each, chosen["t"]) for reading, each in chosen.items()}
    used = {id(each) for each in (*(each.column for each in chosen.values()), *times.values())}
    notes += _unused(path.name, [each for each in table if id(each) not in used], chosen)
    own = {reading: values["t"] if at is None else _seconds(at, path) for reading, at in times.items()}
    merged = _merged(path, chosen, values, own)
    return Log(merged.pop("t"), merged, path.name, tuple(notes))


class LogColumn(NamedTuple):
    """The column of a reading, its unit where it was named, and the column of its own times."""

    column: TableColumn
    unit: str | None = None
    times: TableColumn | None = None


def _chosen(table: Sequence[TableColumn], columns: Mapping[str, str], path: Path) -> dict[str, LogColumn]:
    """Reading → its column, as named or by the readings' names; times without a name are those of ``tau_1``."""
    chosen = dict[str, LogColumn]()
    for reading in UNIT_OF:
        if reading in columns:
            if columns[reading] != OMITTED:
                chosen[reading] = _named(table, columns[reading], path)
            continue
        found = next((each for name in (f"{reading}{READ}", reading) if (each := _found(table, name, path))), None)
        if found:
            chosen[reading] = LogColumn(found)
    if "t" not in columns and "t" not in chosen:
        times = [each for each in table if each.name in TIMES]
        if own := _own_times(table, chosen["tau_1"], None) if "tau_1" in chosen else None:
            chosen["t"] = LogColumn(own)
        elif len(times) == 1:
            chosen["t"] = LogColumn(times[0])
    return chosen


def _found(table: Sequence[TableColumn], name: str, path: Path) -> TableColumn | None:
    """The column with a header, else the one with a name."""
    found = [each for each in table if each.header == name] or [each for each in table if each.name == name]
    if len(found) > 1:
        headers = dict.fromkeys(each.header for each in found)
        which = f"; name one, --column READING=COLUMN: {', '.join(headers)}" if len(headers) > 1 else ""
        raise ConfigurationError(f"{path}: has more than one column '{name}'{which}")
    if found and found[0].content:
        raise ConfigurationError(f"{path}: column '{found[0].header}': is {found[0].content}: must be real numbers")
    return found[0] if found else None


def _named(table: Sequence[TableColumn], text: str, path: Path) -> LogColumn:
    """The column of a text ``COLUMN``, ``COLUMN:UNIT`` or ``COLUMN@TIMES``, or both; names may have colons."""
    name, _, unit = (part.strip() for part in text.rpartition(":"))
    for whole, stated in ((text, None), (name, unit)):
        if found := _found(table, whole, path):
            return LogColumn(found, stated)
        own, _, times = (part.strip() for part in whole.rpartition("@"))
        found, at = _found(table, own, path), _found(table, times, path)
        if own and found and at:
            return LogColumn(found, stated, at)
    wanted = name if name and is_unit(unit.removeprefix("-")) else text
    near = difflib.get_close_matches(wanted, [each.header for each in table], n=1, cutoff=0.6)
    hint = f"did you mean '{near[0]}'? It" if near else "it"
    raise ConfigurationError(f"{path}: unknown column '{wanted}'; {hint} has {listed(each.header for each in table)}")


def _in_si(reading: str, chosen: LogColumn, path: Path) -> Floats:
    if reading == "t":
        return _seconds(chosen.column, path, chosen.unit)
    unit = chosen.unit or chosen.column.unit or UNIT_OF[reading]
    return chosen.column.values * _factor(unit, UNIT_OF[reading], chosen.column, path)


def _factor(unit: str, si: str, column: TableColumn, path: Path) -> float:
    try:
        return 1.0 if unit == si else factor(unit, si)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: column '{column.header}': {error}") from None


def _seconds(column: TableColumn, path: Path, unit: str | None = None) -> Floats:
    """Times in s: time stamps, times since 1970, or as the unit says."""
    if column.stamps:
        return column.values
    stated, first = unit or column.unit, float(column.values[np.isfinite(column.values)][:1].sum())
    if stated is None:
        stated = next((name for name, (low, high) in EPOCHS.items() if low <= first < high), "s")
    return column.values * _factor(stated, "s", column, path)


def _own_times(table: Sequence[TableColumn], chosen: LogColumn, t: LogColumn | None) -> TableColumn | None:
    """The column of a reading's own times: as named, or named after it, or beside it in a structure."""
    if chosen.times or chosen is t:
        return chosen.times
    name, parts = chosen.column.name, chosen.column.header.split(".")
    places = [".".join(parts[:count]) for count in range(len(parts) - 1, 0, -1)]
    beside = [f"{place}.{each}" for place in places for each in ("t", *TIMES)]
    spare = [each for each in table if not t or each is not t.column]
    named = [each for header in (f"t_{name}", f"{name}_t", *beside) for each in spare if each.header == header]
    return next((each for each in named if len(each.values) == len(chosen.column.values)), None)


def _merged(
    path: Path, chosen: Mapping[str, LogColumn], values: Mapping[str, Floats], own: Mapping[str, Floats]
) -> dict[str, Floats]:
    """All readings over one time: that of the log, and in between those of columns with times of their own."""
    for reading, times in own.items():
        if len(times) != len(values[reading]):
            raise ConfigurationError(
                f"{path}: {reading} has {len(values[reading])} values and its times {len(times)}: must be as many; "
                f"name its own times: --column '{reading}={chosen[reading].column.header}@TIMES'"
            )
    if all(times is values["t"] for times in own.values()):
        known = np.isfinite(values["t"])
        return {reading: each[known] for reading, each in values.items()}
    t = np.unique(np.concatenate([times[np.isfinite(times)] for times in own.values()]))
    merged = {"t": t}
    for reading, times in own.items():
        if reading != "t":
            known = np.isfinite(times)
            merged[reading] = np.full(len(t), np.nan)
            merged[reading][np.searchsorted(t, times[known])] = values[reading][known]
    return merged


def _unused(source: str, spare: Sequence[TableColumn], chosen: Mapping[str, LogColumn]) -> Iterator[str]:
    """A note on the columns that were not used, each with the option that would use it."""
    spare = [each for each in spare if each.header and each.name.removesuffix(READ) not in chosen]
    missing = [reading for reading in UNIT_OF if reading not in chosen]
    words = []
    for column in spare:
        if column.content:
            words.append(f"{column.header} ({column.content})")
            continue
        near = difflib.get_close_matches(column.name.lower(), [name.lower() for name in missing], n=1, cutoff=0.5)
        likely = [name for name in missing if name.lower() in near]
        likely += [name for name in missing if column.unit and is_unit(column.unit, UNIT_OF[name])]
        words.append(f"{column.header} (--column '{likely[0]}={column.header}')" if likely else column.header)
    if words:
        how = "" if any("--column" in each for each in words) else "; --column READING=NAME uses one"
        yield f"{source}: not used: {listed(words)}{how}"


def read_columns(path: Path, csv: str = "") -> list[TableColumn]:
    """Read all columns of numbers of a file.

    Raises:
        ConfigurationError: an unknown suffix, or a file that cannot be read.
    """
    suffix = path.with_suffix("").suffix if path.suffix.lower() == ".gz" else path.suffix
    if suffix.lower() not in (*CSV_SUFFIXES, *READERS):
        raise ConfigurationError(f"{path}: unknown suffix {suffix!r}; must be {', '.join((*CSV_SUFFIXES, *READERS))}")
    try:
        return read_csv(path, csv) if suffix.lower() in CSV_SUFFIXES else READERS[suffix.lower()](path)
    except ConfigurationError:
        raise
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, NotImplementedError, EOFError) as error:
        raise ConfigurationError(f"{path}: not a {suffix} file: {str(error).splitlines()[0][:200]}") from error


def _parquet(path: Path) -> list[TableColumn]:
    import pyarrow as pa
    from pyarrow import parquet

    table = parquet.read_table(path)
    units, found = parquet_units(table.schema), list[TableColumn]()
    for field in table.schema:
        values, stamps = table[field.name], pa.types.is_timestamp(field.type)
        if stamps:
            values = values.cast(pa.timestamp("ns", field.type.tz)).cast(pa.int64())
        elif not (pa.types.is_integer(field.type) or pa.types.is_floating(field.type)):
            found.append(_without_numbers(field.name, str(field.type)))
            continue
        numbers = np.array(values.to_numpy(), float) * (1e-9 if stamps else 1.0)
        found.append(TableColumn(field.name, field.name, units.get(field.name), numbers, stamps))
    return found


def _without_numbers(header: str, content: str) -> TableColumn:
    """A column that cannot be a reading, by what it has in the place of real numbers."""
    return TableColumn(header, header.rsplit(".", 1)[-1], None, np.zeros(0), content=content)


def _numpy(path: Path) -> list[TableColumn]:
    with np.load(path, allow_pickle=False) as arrays:
        units = json.loads(str(arrays["units"])) if "units" in arrays.files else {}
        return _of_tree({name: arrays[name] for name in arrays.files}, units)


def _matlab(path: Path) -> list[TableColumn]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError, matfile_version

    try:
        is_hdf5 = matfile_version(path, appendmat=False)[0] == 2
    except MatReadError as error:
        raise ConfigurationError(f"{path}: not a .mat file: {error}") from error
    arrays = _matlab_7_3(path) if is_hdf5 else loadmat(path, simplify_cells=True)
    units = arrays.pop("units", None)
    return _of_tree(arrays, {key: str(unit) for key, unit in units.items()} if isinstance(units, Mapping) else {})


def _matlab_7_3(path: Path) -> dict[str, Any]:
    """Groups and arrays of a file of version 7.3, which is HDF5."""
    try:
        h5py: Any = import_module("h5py")
    except ImportError:
        raise ConfigurationError(
            f"{path}: is of MATLAB's version 7.3: pip install h5py, or save it with save(..., '-v7')"
        ) from None

    def tree(group: Any) -> dict[str, Any]:
        items = {name: each for name, each in group.items() if not name.startswith("#")}
        return {name: array(each) if isinstance(each, h5py.Dataset) else tree(each) for name, each in items.items()}

    def array(dataset: Any) -> Any:
        is_text = dataset.attrs.get("MATLAB_class") == b"char"
        return "" if is_text else np.squeeze(dataset[()]).T

    with h5py.File(path, "r") as file:
        return tree(file)


def _of_tree(tree: Mapping[str, Any], units: Mapping[str, str]) -> list[TableColumn]:
    """Columns of nested arrays: ``rig.F1`` of a structure, ``rig.F.1`` of a matrix, named by the last part."""
    found = list[TableColumn]()
    for header, values in _arrays(tree):
        if isinstance(values, str):
            found.append(_without_numbers(header, values))
            continue
        parts = header.split(".")
        while len(parts) > 1 and parts[-1] in CONTENTS:
            parts.pop()
        name = parts[-1]
        finite = np.where(np.isfinite(values), values, np.nan)
        found.append(TableColumn(header, name, units.get(header), finite))
    return found


def _arrays(tree: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, Floats | str]]:
    """The name of each column of nested arrays, and its numbers, or what it has in the place of numbers."""
    for key, item in tree.items():
        name, each = within + key, item
        if isinstance(item, list):
            each = {str(number): value for number, value in enumerate(item, start=1)}
        if isinstance(each, Mapping):
            yield from _arrays(each, f"{name}.")
        elif not isinstance(each, np.ndarray) or (each.size < 2 and each.dtype.kind != "O"):
            continue  # a name, or a number beside the columns
        elif each.dtype.kind not in "fiu":
            yield name, OTHER_CONTENTS.get(each.dtype.kind, str(each.dtype))
        elif each.ndim == 1:
            yield name, np.array(each, float)
        elif each.ndim == 2:
            yield from ((f"{name}.{k}", np.array(part, float)) for k, part in enumerate(each.T, start=1))
        else:
            yield name, f"of {each.ndim} dimensions"


CSV_SUFFIXES = (".csv", ".txt", ".tsv")
"""Suffixes of files with cells between separators."""

READERS: dict[str, Callable[[Path], list[TableColumn]]] = {".parquet": _parquet, ".npz": _numpy, ".mat": _matlab}
"""Suffix → reader of the others."""
