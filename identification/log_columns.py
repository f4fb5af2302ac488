"""Every column of numbers that a file holds, whoever wrote it, with its unit where the file says it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.recordings import csv_units

Floats = NDArray[np.float64]
Columns = tuple[dict[str, Floats], dict[str, str]]

NOTHING = ["", "nan", "NaN", "NA", "N/A", "null", "NULL", "-"]
"""Words of a CSV file that stand for no reading."""


def read_columns(path: Path) -> Columns:
    """Columns by name, (rows,), NaN for gaps; and units by name.

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

    options = csv.ConvertOptions(null_values=NOTHING, strings_can_be_null=True)
    table = csv.read_csv(path, convert_options=options)
    return _numbers(table), csv_units(path)


def _parquet(path: Path) -> Columns:
    from pyarrow import parquet

    table = parquet.read_table(path)
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema}
    return _numbers(table), {name: unit for name, unit in units.items() if unit}


def _numbers(table: Any) -> dict[str, Floats]:
    import pyarrow as pa

    numeric = (
        field.name for field in table.schema if pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
    )
    return {name: np.array(table[name].to_numpy(), float) for name in numeric}


def _numpy(path: Path) -> Columns:
    with np.load(path, allow_pickle=False) as held:
        columns = {name: np.array(held[name], float) for name in held.files if _is_column(held[name])}
        units = json.loads(str(held["units"])) if "units" in held.files else {}
    return columns, units


def _matlab(path: Path) -> Columns:
    from scipy.io import loadmat

    held = loadmat(path, squeeze_me=True, struct_as_record=True)
    columns = {name: np.array(values, float) for name, values in held.items() if _is_column(values)}
    units = held.get("units")
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
"""Suffix → what reads it."""
