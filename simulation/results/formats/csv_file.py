"""CSV: a header and full double-precision numbers; all else stands beside it, as the W3C's "CSV on the Web" has it."""

import json
from pathlib import Path
from typing import Any

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.results.content import Content, about

OWN = "dualwinch:"
"""What the names of our own entries begin with."""


def metadata_path(path: Path) -> Path:
    """``FILE-metadata.json``, where readers of "CSV on the Web" look for it."""
    return path.with_name(path.name + "-metadata.json")


def write(content: Content, path: Path) -> None:
    """Write a file and its metadata; NaN becomes empty."""
    import pyarrow as pa
    from pyarrow import csv

    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in content.columns.items()})
    with atomic(path) as unfinished, atomic(metadata_path(path)) as unfinished_metadata:
        csv.write_csv(table, unfinished, csv.WriteOptions(quoting_style="none", quoting_header="none"))
        text = json.dumps(_metadata(content, path.name), indent=2, allow_nan=False)
        unfinished_metadata.write_text(text + "\n", encoding="utf-8")


def read(path: Path) -> Content:
    """Read a file of numbers and its metadata.

    Raises:
        ConfigurationError: there is no metadata.
    """
    import pyarrow as pa
    from pyarrow import csv

    beside = metadata_path(path)
    if not beside.exists():
        raise ConfigurationError(f"{beside.name} is not beside it; units and the experiment stand there")
    described = json.loads(beside.read_text(encoding="utf-8"))
    quantities = {
        column["name"]: Quantity(column[f"{OWN}unit"], column["titles"], column.get(f"{OWN}source", ""))
        for column in described["tableSchema"]["columns"]
    }
    numbers = csv.ConvertOptions(column_types=dict.fromkeys(quantities, pa.float64()), null_values=[""])
    table = csv.read_csv(path, convert_options=numbers)
    return Content(
        columns={name: table[name].to_numpy().copy() for name in quantities},
        quantities=quantities,
        facts={key.removeprefix(OWN): value for key, value in described.items() if key.startswith(OWN)},
    )


def _metadata(content: Content, name: str) -> dict[str, Any]:
    columns = []
    for column, quantity in content.quantities.items():
        kind = {"datatype": "double"} if content.columns[column].dtype.kind == "f" else {}
        said = {f"{OWN}{key}": text for key, text in about(quantity).items() if key != "meaning"}
        columns.append({"name": column, "titles": quantity.meaning, **kind, **said})
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": name,
        "tableSchema": {"columns": columns},
        **{f"{OWN}{key}": value for key, value in content.facts.items()},
    }
