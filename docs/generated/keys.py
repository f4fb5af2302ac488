"""Every configuration key, from the annotations beside the fields."""

from itertools import groupby
from typing import Any

from docs.generated.text import code, table, unit
from dualwinch.config.toml_text import toml_value
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Leaf
from dualwinch.simulation.experiment import Experiment


def _default(leaf: Leaf) -> str:
    value: Any = leaf.default
    return code(toml_value(value)) if isinstance(value, (bool, int, float, str, tuple)) and value != "" else ""


def _row(leaf: Leaf) -> list[str]:
    name, quantity = leaf.key.rsplit(".", 1)[-1], leaf.quantity
    allowed = " ".join(map(code, leaf.choices)) or leaf.allowed
    return [code(name), unit(quantity.unit), quantity.meaning, allowed, _default(leaf), quantity.source]


def _table_of(leaf: Leaf) -> str:
    return leaf.key.rpartition(".")[0]


def keys_markdown() -> str:
    """A section for each part of an experiment, in it a table for each TOML table."""
    leaves = sorted(describe(Experiment).values(), key=_table_of)
    tables = {name: list(group) for name, group in groupby(leaves, key=_table_of)}
    text = []
    for top, names in groupby(tables, key=lambda name: name.partition(".")[0]):
        text.append(f"## {top or 'top of the file'}\n")
        for name in names:
            text.append(f"### `[{name}]`\n" if name else "")
            rows = [_row(leaf) for leaf in tables[name]]
            text.append(table(["key", "unit", "meaning", "allowed", "default", "source"], rows) + "\n")
    return "\n".join(text)
