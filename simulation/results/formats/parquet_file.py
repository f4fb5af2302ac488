"""Parquet: units and meanings in the fields' metadata, facts in the schema's."""

import json
from pathlib import Path

from dualwinch.codegen.files import atomic
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.results.content import Content, about

OWN = "dualwinch."
"""What the names of facts begin with."""

KNOWN = (b"unit", b"meaning", b"source")
"""Metadata of a field that is ours; writers and readers add their own."""


def write(content: Content, path: Path) -> None:
    """Write a file; NaN becomes null, and texts stand as they are among facts in JSON."""
    import pyarrow as pa
    from pyarrow import parquet

    arrays = [pa.array(content.columns[name], from_pandas=True) for name in content.quantities]
    fields = [
        pa.field(name, array.type, metadata=about(quantity))
        for array, (name, quantity) in zip(arrays, content.quantities.items(), strict=True)
    ]
    facts = {OWN + key: value if isinstance(value, str) else json.dumps(value) for key, value in content.facts.items()}
    with atomic(path) as unfinished:
        table = pa.table(arrays, schema=pa.schema(fields, metadata=facts))
        parquet.write_table(table, unfinished, compression="zstd")


def read(path: Path) -> Content:
    """Read a file of numbers."""
    from pyarrow import parquet

    table = parquet.read_table(path)
    said = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    quantities = {
        field.name: Quantity(**{key.decode(): value.decode() for key, value in field.metadata.items() if key in KNOWN})
        for field in table.schema
    }
    return Content(
        columns={name: table[name].to_numpy().copy() for name in quantities},
        quantities=quantities,
        facts={key.removeprefix(OWN): value for key, value in said.items() if key.startswith(OWN)},
    )
