"""Logs: torque commands and sensor readings of a machine, from files, arrays and simulated runs."""

import difflib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.controllers.parts import Measurement
from dualwinch.identification.predictor import READINGS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import unknown
from dualwinch.model.recordings import csv_units, factor, parquet_units
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.rows import READ

Floats = NDArray[np.float64]
Columns = tuple[dict[str, Floats], dict[str, str]]

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

OMITTED = "-"
"""In the place of a column's name: the reading is left out."""

GAPS = ["", "nan", "NaN", "NA", "N/A", "null", "NULL", "-"]
"""Cells of a CSV file that are gaps."""


@dataclass(frozen=True, eq=False)
class Log:
    """A log.

    Attributes:
        t: (n,) time of each row in s, ascending.
        columns: name → (n,) in SI units: torque commands ``tau_1``, ``tau_2`` at the motors, and some of
            `identification.predictor.READINGS`. NaN where nothing was recorded.
        name: of the log in messages.
    """

    t: Floats
    columns: Mapping[str, Floats]
    name: str = "log"

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            ConfigurationError: no rows, time that stands still or goes back, no torques, no position or encoder.
        """
        if len(self.t) < 2:
            raise ConfigurationError(f"{self.name}: has {len(self.t)} rows: must be 2 or more")
        if not np.isfinite(self.t).all():
            raise ConfigurationError(f"{self.name}: t: must be a finite number in every row")
        backwards = np.flatnonzero(np.diff(self.t) <= 0)
        if len(backwards):
            row = int(backwards[0]) + 1
            raise ConfigurationError(
                f"{self.name}: t = {self.t[row]:g} s in row {row + 1} after {self.t[row - 1]:g} s: must ascend"
            )
        _check_columns(self.name, self.columns)
        for name in TORQUES:
            if not np.isfinite(self.columns[name]).any():
                raise ConfigurationError(f"{self.name}: {name}: has no value in any row, and torques drive the fit")

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
        first, last = (
            replace(self, t=self.t[rows], columns={name: values[rows] for name, values in self.columns.items()})
            for rows in (early, ~early)
        )
        return first, last


def log(columns: Mapping[str, ArrayLike], name: str = "log") -> Log:
    """A log of arrays: ``t`` in s, torque commands, and readings, all in SI units.

    Raises:
        ConfigurationError: an unknown column, columns of different lengths, or no log (`Log`).
    """
    for column in columns:
        if column not in UNIT_OF:
            raise ConfigurationError(f"{name}: {unknown('column', column, UNIT_OF)}")
    if "t" not in columns:
        raise ConfigurationError(f"{name}: t: no such column; it has {', '.join(columns)}")
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


class LogColumn(NamedTuple):
    """A column of a file, `OMITTED`: none, and its unit; None: as the file says, else the SI unit."""

    name: str
    unit: str | None = None


def column_map(texts: Sequence[str]) -> dict[str, LogColumn]:
    """Columns from texts such as ``F1=load_cell_left``, ``F1=load_cell_left:kN`` or ``F1=-``, which leaves it out.

    Raises:
        ConfigurationError: another form, or an unknown reading or unit.
    """
    found = {}
    for text in texts:
        parts = re.fullmatch(r"\s*(\w+)\s*=\s*([^:]+?)\s*(?::\s*(\S.*?))?\s*", text)
        if not parts:
            raise ConfigurationError(f"--column {text}: must be READING=COLUMN or READING=COLUMN:UNIT, e.g. F1=left:kN")
        reading, name, unit = parts.groups()
        if reading not in UNIT_OF:
            raise ConfigurationError(f"--column {text}: {unknown('reading', reading, UNIT_OF)}")
        if unit is not None:
            try:
                factor(unit, UNIT_OF[reading])
            except ConfigurationError as error:
                raise ConfigurationError(f"--column {text}: {error}") from None
        found[reading] = LogColumn(name, unit)
    return found


def read_log(file: str | PathLike[str], columns: Mapping[str, LogColumn] | None = None) -> Log:
    """Read a log from a file: CSV, Parquet, MATLAB or NumPy; empty cells and NaN are gaps.

    Columns are found by the names of readings (``x``, ``F1``, ...), or by these with ``_read``, as runs have them that
    were written with ``simulation.readings``.

    Args:
        file: its path.
        columns: reading → its column, where that has another name.

    Raises:
        ConfigurationError: the file cannot be read, lacks a column that was named, or is no log (`Log`).
    """
    path, columns = Path(file), columns or {}
    table, units = read_columns(path)
    found: dict[str, Floats] = {}
    for reading, si in UNIT_OF.items():
        given = columns.get(reading)
        if given and given.name == OMITTED:
            continue
        names = [given.name] if given else [f"{reading}{READ}", reading]
        name = next((name for name in names if name in table), None)
        if name is None:
            if given:
                near = difflib.get_close_matches(given.name, table, n=1, cutoff=0.6)
                hint = f"did you mean '{near[0]}'? It" if near else "it"
                raise ConfigurationError(f"{path}: unknown column '{given.name}'; {hint} has {_listed(table)}")
            continue
        unit = (given.unit if given else None) or units.get(name) or si
        try:
            found[reading] = table[name] * (1.0 if unit == si else factor(unit, si))
        except ConfigurationError as error:
            raise ConfigurationError(f"{path}: column '{name}': {error}") from None
    _check_columns(str(path), found, table, ("t",))
    return Log(found.pop("t"), found, path.name)


def _check_columns(
    source: str, found: Iterable[str], columns: Iterable[str] = (), required: Sequence[str] = ()
) -> None:
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
    raise ConfigurationError(f"{source}: {words}{hint} {_listed(columns or found)}")


def _listed(columns: Iterable[str], most: int = 12) -> str:
    """Names of columns in a message, no more than so many."""
    names = list(columns)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def read_columns(path: Path) -> Columns:
    """Read all columns of numbers of a file: by name (rows,), NaN for gaps; and units by name.

    Raises:
        ConfigurationError: an unknown suffix, or a file that cannot be read.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ConfigurationError(f"{path}: unknown suffix {path.suffix!r}; must be {', '.join(READERS)}")
    try:
        return reader(path)
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, NotImplementedError) as error:
        raise ConfigurationError(f"{path}: not a {path.suffix} file: {str(error).splitlines()[0][:200]}") from error


def _csv(path: Path) -> Columns:
    from pyarrow import csv

    options = csv.ConvertOptions(null_values=GAPS, strings_can_be_null=True)
    return _numbers(csv.read_csv(path, convert_options=options)), csv_units(path)


def _parquet(path: Path) -> Columns:
    from pyarrow import parquet

    table = parquet.read_table(path)
    return _numbers(table), parquet_units(table.schema)


def _numbers(table: Any) -> dict[str, Floats]:
    import pyarrow as pa

    numeric = (
        field.name for field in table.schema if pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
    )
    return {name: np.array(table[name].to_numpy(), float) for name in numeric}


def _numpy(path: Path) -> Columns:
    with np.load(path, allow_pickle=False) as arrays:
        columns = {name: np.array(arrays[name], float) for name in arrays.files if _is_column(arrays[name])}
        units = json.loads(str(arrays["units"])) if "units" in arrays.files else {}
    return columns, units


def _matlab(path: Path) -> Columns:
    from scipy.io import loadmat

    arrays = loadmat(path, squeeze_me=True, struct_as_record=True)
    columns = {name: np.array(values, float) for name, values in arrays.items() if _is_column(values)}
    units = arrays.get("units")
    names = getattr(getattr(units, "dtype", None), "names", None) or ()
    return columns, {name: str(units[name]) for name in names} if units is not None else {}


def _is_column(values: object) -> bool:
    return isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind in "fiu" and values.size > 1


READERS: dict[str, Callable[[Path], Columns]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".npz": _numpy,
    ".mat": _matlab,
}
"""Suffix → reader."""
