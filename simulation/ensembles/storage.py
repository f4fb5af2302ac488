"""Files of an ensemble's result: one row a scenario, as CSV, Parquet, NumPy or JSON; units travel with each."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.description import describe
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantity import Quantity
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.metrics import Metrics


@dataclass(frozen=True)
class Column:
    """One column: its values, one a scenario, and what they are."""

    values: NDArray[Any]
    quantity: Quantity


def columns(result: EnsembleResult) -> dict[str, Column]:
    """Every column of a result: number of the scenario, drawn values, outcome, end, figures of merit."""
    drawn, merits = describe(Experiment), describe(Metrics)
    first = {"scenario": Column(np.arange(len(result)), Quantity("", "number of the scenario"))}
    draws = {key: Column(values, drawn[key].quantity) for key, values in result.draws.items()}
    ends = {
        "outcome": Column(np.array(result.outcomes), Quantity("", "how the run ended")),
        "end_time": Column(result.end_times, Quantity("s", "time at which the run ended")),
    }
    metrics = {name: Column(values, merits[name].quantity) for name, values in result.metrics.items()}
    return first | draws | ends | metrics


def facts(result: EnsembleResult, notes: Mapping[str, str]) -> dict[str, Any]:
    """What travels with the columns, JSON-ready (NaN becomes null)."""
    statistics = {name: _finite(values) for name, values in result.statistics.items()}
    return {
        "ensemble": result.ensemble.name,
        "ensemble_seed": result.seed,
        "scenarios_asked": result.asked,
        "outcomes": result.outcome_counts,
        "statistics": statistics,
        **notes,
    }


def save_ensemble(result: EnsembleResult, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
    """Write a result to a file; the file appears whole or not at all.

    As with a single run (`simulation.storage.save`) a CSV file's units stand beside it in ``FILE-metadata.json``; the
    other formats carry units, seed, statistics and notes inside.

    Args:
        result: what to write.
        path: its suffix chooses the format: csv, parquet, npz, json.
        notes: texts to keep with the result, such as the ensemble's TOML.

    Raises:
        ConfigurationError: unknown suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    write = ensemble_writer(path)
    about = facts(result, notes or {})
    table = columns(result)
    with atomic(path) as unfinished:
        write(table, about, unfinished)
    if path.suffix.lower() == ".csv":
        with atomic(path.with_name(path.name + "-metadata.json")) as unfinished:
            unfinished.write_text(json.dumps(_csv_metadata(table, about, path.name), indent=2), encoding="utf-8")


def ensemble_writer(path: str | PathLike[str]) -> Callable[[dict[str, Column], dict[str, Any], Path], None]:
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


def _table(table: dict[str, Column]) -> Any:
    import pyarrow as pa

    arrays = [pa.array(column.values, from_pandas=True) for column in table.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": column.quantity.unit, "meaning": column.quantity.meaning})
        for array, (name, column) in zip(arrays, table.items(), strict=True)
    ]
    return pa.table(arrays, schema=pa.schema(fields))


def _write_csv(table: dict[str, Column], about: dict[str, Any], path: Path) -> None:  # noqa: ARG001
    from pyarrow import csv

    csv.write_csv(_table(table), path, csv.WriteOptions(quoting_style="none", quoting_header="none"))


def _csv_metadata(table: dict[str, Column], about: dict[str, Any], name: str) -> dict[str, Any]:
    described = [
        {"name": key, "titles": column.quantity.meaning, "dualwinch:unit": column.quantity.unit}
        for key, column in table.items()
    ]
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": name,
        "tableSchema": {"columns": described},
        **{f"dualwinch:{key}": value for key, value in about.items()},
    }


def _write_parquet(table: dict[str, Column], about: dict[str, Any], path: Path) -> None:
    from pyarrow import parquet

    metadata = {f"dualwinch.{key}": _text(value) for key, value in about.items()}
    parquet.write_table(_table(table).replace_schema_metadata(metadata), path, compression="zstd")


def _write_npz(table: dict[str, Column], about: dict[str, Any], path: Path) -> None:
    units = {name: column.quantity.unit for name, column in table.items()}
    arrays = {name: column.values for name, column in table.items()}
    arrays |= {name: np.array(_text(value)) for name, value in {"units": units, **about}.items()}
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]  # names are free


def _write_json(table: dict[str, Column], about: dict[str, Any], path: Path) -> None:
    units = {name: column.quantity.unit for name, column in table.items()}
    rows = zip(*(column.values.tolist() for column in table.values()), strict=True)
    content = {**about, "units": units, "scenarios": [_finite(dict(zip(table, row, strict=True))) for row in rows]}
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value for name, value in values.items()
    }


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


WRITERS: dict[str, Callable[[dict[str, Column], dict[str, Any], Path], None]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".npz": _write_npz,
    ".json": _write_json,
}
"""Suffix → what writes it."""
