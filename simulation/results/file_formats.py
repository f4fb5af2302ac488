"""Result files: CSV, Parquet, NumPy and MATLAB, chosen by suffix; all include units and the experiment."""

import json
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic, write_whole
from dualwinch.model.arguments import path_of, suffix_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.figures import plain
from dualwinch.model.quantities.quantity import Mark, Quantity, unknown
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metrics_with
from dualwinch.simulation.results.result import Result

INFINITE = {"INF": math.inf, "-INF": -math.inf}
"""Infinite numbers in JSON, which has none: written as in XML Schema and the W3C's "CSV on the Web"."""


@dataclass(frozen=True)
class FileContent:
    """Content of a file.

    Attributes:
        columns: name → (rows,).
        quantities: name → unit and meaning of every column.
        facts: name → text, or a value that JSON can express (`plain`).
    """

    columns: Mapping[str, NDArray[Any]]
    quantities: Mapping[str, Quantity]
    facts: Mapping[str, Any]

    @classmethod
    def of(cls, columns: Mapping[str, tuple[NDArray[Any], Quantity]], facts: Mapping[str, Any]) -> Self:
        """The content of columns with quantities, and of facts."""
        values = {name: values for name, (values, _) in columns.items()}
        return cls(values, {name: quantity for name, (_, quantity) in columns.items()}, plain(facts))

    @property
    def units(self) -> dict[str, str]:
        """Column → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Rows as dictionaries of column name → value, for JSON."""
        rows = zip(*(values.tolist() for values in self.columns.values()), strict=True)
        return [plain(dict(zip(self.columns, row, strict=True))) for row in rows]

    @property
    def texts(self) -> dict[str, str]:
        """The facts as texts; those that are no texts, as JSON."""
        return {key: value if isinstance(value, str) else json.dumps(value) for key, value in self.facts.items()}


def number(value: Any) -> float:
    """A number from its form in JSON (`plain`)."""
    if value is None:
        return math.nan
    return INFINITE[value] if value in INFINITE else float(value)


def about(quantity: Quantity) -> dict[str, str]:
    """The non-empty texts of a quantity."""
    texts = {"unit": quantity.unit, "meaning": quantity.meaning, "source": quantity.source}
    return {name: text for name, text in texts.items() if text or name != "source"}


CSV_OURS = "dualwinch:"
"""Prefix of dualwinch's entries."""


def metadata_path(path: Path) -> Path:
    """``FILE-metadata.json``, the location defined by "CSV on the Web"."""
    return path.with_name(path.name + "-metadata.json")


def _write_csv(content: FileContent, path: Path) -> None:
    """Write a file and its metadata; NaN becomes empty."""
    import pyarrow as pa
    from pyarrow import csv

    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in content.columns.items()})
    text = json.dumps(_csv_metadata(content, path.name), indent=2, allow_nan=False)
    with atomic(path) as unfinished:
        with unfinished.open("wb") as file:  # of a path, the library wants it to be UTF-8
            file.write((",".join(table.column_names) + "\n").encode())
            csv.write_csv(table, file, csv.WriteOptions(include_header=False, quoting_style="none"))
        write_whole(metadata_path(path), text + "\n")


def _read_csv(path: Path) -> FileContent:
    """Read a file of numbers and its metadata.

    Raises:
        ConfigurationError: the metadata is missing.
    """
    import pyarrow as pa
    from pyarrow import csv

    beside = metadata_path(path)
    if not beside.exists():
        raise ConfigurationError(f"{beside.name} is not beside it; units and the experiment are in that file")
    described = json.loads(beside.read_text(encoding="utf-8"))
    quantities = {
        column["name"]: Quantity(column[f"{CSV_OURS}unit"], column["titles"], column.get(f"{CSV_OURS}source", ""))
        for column in described["tableSchema"]["columns"]
    }
    numbers = csv.ConvertOptions(column_types=dict.fromkeys(quantities, pa.float64()), null_values=[""])
    with path.open("rb") as file:
        table = csv.read_csv(file, convert_options=numbers)
    return FileContent(
        columns={name: table[name].to_numpy().copy() for name in quantities},
        quantities=quantities,
        facts={key.removeprefix(CSV_OURS): value for key, value in described.items() if key.startswith(CSV_OURS)},
    )


def _csv_metadata(content: FileContent, name: str) -> dict[str, Any]:
    columns = []
    for column, quantity in content.quantities.items():
        kind = {"datatype": "double"} if content.columns[column].dtype.kind == "f" else {}
        entries = {f"{CSV_OURS}{key}": text for key, text in about(quantity).items() if key != "meaning"}
        columns.append({"name": column, "titles": quantity.meaning, **kind, **entries})
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": name,
        "tableSchema": {"columns": columns},
        **{f"{CSV_OURS}{key}": value for key, value in content.facts.items()},
    }


LONGEST_NAME = 63
"""Maximum length of a name in MATLAB."""


def _write_matlab(content: FileContent, path: Path) -> None:
    """Write a file; in column names, characters other than letters and digits become underscores.

    Raises:
        ConfigurationError: two columns, or a column and another entry, would have the same name.
    """
    from scipy.io import savemat

    variables = {name: re.sub(r"\W", "_", name)[:LONGEST_NAME] for name in content.columns}
    described = {variables[name]: {"name": name, **about(quantity)} for name, quantity in content.quantities.items()}
    units = {variables[name]: unit for name, unit in content.units.items()}
    entries: dict[str, Any] = {"units": units, "columns": json.dumps(described)}
    entries |= {key: _matlab_entry(value) for key, value in content.facts.items()}
    for name, variable in variables.items():
        if variable in entries:
            raise ConfigurationError(f"column '{name}': .mat files have another entry of this name; save as .parquet")
        entries[variable] = content.columns[name]
    with atomic(path) as unfinished:
        savemat(unfinished, entries, oned_as="column", do_compression=True, long_field_names=True)


def _matlab_entry(value: Any) -> Any:
    """A fact for MATLAB: a structure if it consists of numbers with simple names, else JSON."""
    if not isinstance(value, Mapping):
        return value
    simple = all(
        str(key).isidentifier() and (item is None or isinstance(item, (int, float))) for key, item in value.items()
    )
    return {key: number(item) for key, item in value.items()} if simple else json.dumps(value)


def _read_matlab(path: Path) -> FileContent:
    """Read a file of numbers.

    Raises:
        ValueError: it is no .mat file, or is damaged.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        fields = loadmat(path, simplify_cells=True)
    except MatReadError as error:
        raise ValueError(error) from error
    described = json.loads(fields["columns"])
    names = {variable: texts.pop("name") for variable, texts in described.items()}
    return FileContent(
        columns={name: np.array(fields[variable], float).ravel() for variable, name in names.items()},
        quantities={names[variable]: Quantity(**texts) for variable, texts in described.items()},
        facts={key: value for key, value in fields.items() if key not in names and not key.startswith("__")},
    )


def _write_numpy(content: FileContent, path: Path) -> None:
    """Write a file.

    Raises:
        ConfigurationError: a column has the name of another entry.
    """
    described = {name: about(quantity) for name, quantity in content.quantities.items()}
    facts = {"units": json.dumps(content.units), "columns": json.dumps(described), **content.texts}
    texts = {key: np.array(text) for key, text in facts.items()}
    for name in sorted(texts.keys() & content.columns.keys()):
        raise ConfigurationError(f"column '{name}': .npz files have another entry of this name; save as .parquet")
    with atomic(path) as unfinished:
        np.savez_compressed(unfinished, **content.columns, **texts)  # pyright: ignore[reportArgumentType]  # any name


def _read_numpy(path: Path) -> FileContent:
    """Read a file of numbers."""
    with path.open("rb") as file, np.load(file) as arrays:
        described = json.loads(str(arrays["columns"]))
        return FileContent(
            columns={name: arrays[name] for name in described},
            quantities={name: Quantity(**texts) for name, texts in described.items()},
            facts={name: str(arrays[name]) for name in arrays.files if name not in described},
        )


OURS = "dualwinch."
"""Prefix of the names of facts."""

FIELD_METADATA = (b"unit", b"meaning", b"source")
"""Field metadata written by dualwinch; Parquet libraries add their own."""


def _write_parquet(content: FileContent, path: Path) -> None:
    """Write a file; NaN becomes null, facts become JSON except texts."""
    import pyarrow as pa
    from pyarrow import parquet

    arrays = [pa.array(content.columns[name], from_pandas=True) for name in content.quantities]
    fields = [
        pa.field(name, array.type, metadata=about(quantity))
        for array, (name, quantity) in zip(arrays, content.quantities.items(), strict=True)
    ]
    facts = {OURS + key: text for key, text in content.texts.items()}
    table = pa.table(arrays, schema=pa.schema(fields, metadata=facts))
    with atomic(path) as unfinished, unfinished.open("wb") as file:
        parquet.write_table(table, file, compression="zstd")


def _read_parquet(path: Path) -> FileContent:
    """Read a file of numbers."""
    from pyarrow import parquet

    with path.open("rb") as file:
        table = parquet.read_table(file)
    entries = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    quantities = {
        field.name: Quantity(
            **{key.decode(): value.decode() for key, value in field.metadata.items() if key in FIELD_METADATA}
        )
        for field in table.schema
    }
    return FileContent(
        columns={name: table[name].to_numpy().copy() for name in quantities},
        quantities=quantities,
        facts={key.removeprefix(OURS): value for key, value in entries.items() if key.startswith(OURS)},
    )


@dataclass(frozen=True)
class Format:
    """A file format: functions that write content to a path, whole or not at all, and that read it.

    Facts other than texts may be read as JSON text.
    """

    write: Callable[[FileContent, Path], None]
    read: Callable[[Path], FileContent]


FORMATS = {
    ".csv": Format(_write_csv, _read_csv),
    ".parquet": Format(_write_parquet, _read_parquet),
    ".npz": Format(_write_numpy, _read_numpy),
    ".mat": Format(_write_matlab, _read_matlab),
}
"""Suffix → format."""


MIXED = (".csv", ".parquet", ".npz")
"""Suffixes of formats whose columns may be texts."""


def format_of(path: Path) -> Format:
    """The format for a path's suffix.

    Raises:
        ConfigurationError: there is none.
    """
    return FORMATS[suffix_of(path, FORMATS)]


def rebuilt(values: Mapping[str, Any], base: Experiment) -> Experiment:
    """Rebuild an experiment from its `leaves`; missing values and parts that are not registered are those of `base`.

    Raises:
        ConfigurationError: an unknown kind of part, an unknown key, or a value out of range.
    """
    for key, leaf in describe_parts(base).items():
        if key in values and not {Mark.PART, Mark.PARTS}.isdisjoint(leaf.marks) and not leaf.admits(values[key]):
            raise ConfigurationError(
                f"{key} = {shown(values[key])}: no such part is registered; "
                "register it, dw.register(YourClass), or give an experiment that has it, as load_result(path, base)"
            )
    experiment = with_leaves(base, values)
    values_of_experiment = leaves(experiment)
    for key in values:
        if key not in values_of_experiment:
            raise ConfigurationError(unknown("key", key, values_of_experiment))
    return experiment


UNREADABLE = (ValueError, LookupError, TypeError, AttributeError, NotImplementedError, EOFError)
"""Errors of the libraries for a file whose format does not match its suffix."""


def save(result: Result, path: str | PathLike[str], notes: Mapping[str, str] | None = None) -> None:
    """Write a result to a file, which appears whole or not at all; `load_result` reads it back.

    A CSV file contains only the header and full double-precision numbers; everything else goes into
    ``FILE-metadata.json`` beside it, as in the W3C's "CSV on the Web". The other formats contain units, meanings,
    figures of merit, outcome, final state, the experiment with every value, and notes.

    Args:
        result: result to write.
        path: file; its suffix selects the format: csv, parquet, npz, mat.
        notes: further texts to save, such as versions.

    Raises:
        ConfigurationError: an unknown suffix, or not the result of a run.
        OSError: the file cannot be written.

    Example:
        >>> import dualwinch as dw
        >>> result = dw.simulate(dw.override(dw.case(2), {"simulation.duration": 0.1}))
        >>> dw.save(result, "run.csv")
    """
    if not isinstance(result, Result):
        raise ConfigurationError(
            f"result: is a {type(result).__name__}: must be the Result of a run (an ensemble's is written by "
            "save_ensemble, an experiment by Path(...).write_text(to_toml(experiment)))"
        )
    path = Path(path)
    facts = dict(notes or {}) | _facts(result)
    format_of(path).write(FileContent(result.columns, result.quantities, facts), path)


def load_result(path: str | PathLike[str], base: Experiment | None = None) -> Result:
    """Read a result written by `save`; it equals the saved one, bit for bit.

    Args:
        path: file; its suffix determines the format.
        base: an experiment with those parts of the saved one that are not registered, such as a law of your own.

    Raises:
        ConfigurationError: the file cannot be read, contains no result, or one with unknown parts; or a CSV file's
            metadata is not beside it.

    Example:
        >>> import dualwinch as dw
        >>> dw.save(dw.simulate(dw.override(dw.case(2), {"simulation.duration": 0.1})), "run.npz")
        >>> dw.load_result("run.npz").experiment.simulation.duration
        0.1
    """
    path = path_of("path", path)
    read = format_of(path).read
    try:
        with path.open("rb"):  # errors of the libraries below are less clear
            pass
        return _result_of(read(path), base or Experiment())
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or 'it is damaged'}") from error
    except (*UNREADABLE, zipfile.BadZipFile, zlib.error) as error:
        raise ConfigurationError(f"{path}: holds no result that dualwinch has saved, or is damaged") from error


def _facts(result: Result) -> dict[str, Any]:
    """Facts written in addition to the columns."""
    facts = {
        "outcome": result.outcome,
        "end_time": result.end_time,
        "metrics": asdict(result.metrics),
        "final_state": result.final_state,
        "experiment": leaves(result.experiment),
    }
    if result.nominal is not None:
        facts["nominal"] = leaves(result.nominal)
    return plain(facts)


def _result_of(content: FileContent, base: Experiment) -> Result:
    lengths = {name: len(values) for name, values in content.columns.items()}
    if len(set(lengths.values())) > 1:
        (reference, rows), *further_lengths = lengths.items()
        odd, count = next((name, count) for name, count in further_lengths if count != rows)
        raise ConfigurationError(f"column '{odd}' has {count} rows: must have {rows}, as '{reference}'")
    facts = {key: content.facts[key] for key in ("end_time", "metrics", "final_state", "experiment")}
    facts |= {"nominal": content.facts.get("nominal")}
    facts = {key: json.loads(value) if isinstance(value, str) else value for key, value in facts.items()}
    experiment = rebuilt(facts["experiment"], base)
    metrics = {name: number(value) for name, value in facts["metrics"].items()}
    return Result(
        columns={name: np.asarray(values, float) for name, values in content.columns.items()},
        metrics=metrics_with(experiment.metrics)(**metrics),
        outcome=content.facts["outcome"],
        end_time=number(facts["end_time"]),
        final_state={name: number(value) for name, value in facts["final_state"].items()},
        experiment=experiment,
        quantities=content.quantities,
        nominal=None if facts["nominal"] is None else with_leaves(base.plant, facts["nominal"]),
    )
