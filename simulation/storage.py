"""Result files: CSV, Parquet, NumPy and MATLAB, chosen by suffix; units travel with each."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.result import Result


def save(result: Result, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
    """Write a result to a file; the file appears whole or not at all.

    A CSV file holds nothing but the header and full double-precision numbers (empty where the controller lacks the
    signal); its units stand beside it in ``FILE-metadata.json``, in the form of the W3C's "CSV on the Web". The
    other formats carry units, figures of merit, outcome and notes inside.

    Args:
        result: what to write.
        path: its suffix chooses the format: csv, parquet, npz, mat.
        notes: texts to keep with the result, such as its configuration.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    write = writer(path)
    with atomic(path) as unfinished:
        write(result, unfinished, dict(notes or {}))
    if path.suffix.lower() == ".csv":
        with atomic(path.with_name(path.name + "-metadata.json")) as unfinished:
            unfinished.write_text(json.dumps(_csv_metadata(result, path.name, dict(notes or {})), indent=2))


def writer(path: str | PathLike[str]) -> Callable[[Result, Path, dict[str, str]], None]:
    """What writes the format of a path's suffix.

    Raises:
        ConfigurationError: unknown suffix.
    """
    path = Path(path)
    try:
        return WRITERS[path.suffix.lower()]
    except KeyError:
        allowed = ", ".join(WRITERS)
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be one of {allowed}") from None


def _facts(result: Result, notes: dict[str, str]) -> dict[str, Any]:
    """What travels with the columns, JSON-ready (NaN becomes null)."""
    metrics = {name: value if np.isfinite(value) else None for name, value in asdict(result.metrics).items()}
    return {"outcome": result.outcome, "end_time": result.end_time, "metrics": metrics, **notes}


def _table(result: Result) -> Any:
    import pyarrow as pa

    fields = [
        pa.field(name, pa.float64(), metadata={"unit": quantity.unit, "meaning": quantity.meaning})
        for name, quantity in result.quantities.items()
    ]
    return pa.table([result.columns[name] for name in result.quantities], schema=pa.schema(fields))


def _write_csv(result: Result, path: Path, notes: dict[str, str]) -> None:  # noqa: ARG001
    import pyarrow as pa
    from pyarrow import csv

    columns = [pa.array(values, from_pandas=True) for values in result.columns.values()]  # NaN becomes empty
    options = csv.WriteOptions(quoting_style="none", quoting_header="none")
    csv.write_csv(pa.table(columns, names=list(result.columns)), path, options)


def _csv_metadata(result: Result, name: str, notes: dict[str, str]) -> dict[str, Any]:
    columns = [
        {"name": column, "titles": quantity.meaning, "datatype": "double", "dualwinch:unit": quantity.unit}
        for column, quantity in result.quantities.items()
    ]
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": name,
        "tableSchema": {"columns": columns},
        **{f"dualwinch:{key}": value for key, value in _facts(result, notes).items()},
    }


def _write_parquet(result: Result, path: Path, notes: dict[str, str]) -> None:
    from pyarrow import parquet

    table = _table(result)
    facts = {f"dualwinch.{key}": _text(value) for key, value in _facts(result, notes).items()}
    parquet.write_table(table.replace_schema_metadata(facts), path, compression="zstd")


def _write_npz(result: Result, path: Path, notes: dict[str, str]) -> None:
    facts = {key: np.array(_text(value)) for key, value in _facts(result, notes).items()}
    arrays = {**result.columns, "units": np.array(json.dumps(result.units)), **facts}
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]  # names are free


def _write_mat(result: Result, path: Path, notes: dict[str, str]) -> None:
    from scipy.io import savemat

    facts = _facts(result, notes) | {"metrics": asdict(result.metrics)}
    savemat(path, {**result.columns, "units": result.units, **facts}, oned_as="column", do_compression=True)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


WRITERS: dict[str, Callable[[Result, Path, dict[str, str]], None]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".npz": _write_npz,
    ".mat": _write_mat,
}
"""Suffix → what writes it."""
