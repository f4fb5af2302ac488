"""What ``dualwinch sweep`` prints and writes."""

import json
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from dualwinch.commands.output import styled, terminal
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.results.file_formats import FileContent, plain
from dualwinch.simulation.sweep import Sweep


def content_of(found: Sweep) -> FileContent:
    """What a file holds: a row for each run, with the values of the keys, outcome, end and figures of merit."""
    points = list(product(*found.values))
    columns: dict[str, tuple[np.ndarray, Quantity]] = {
        key: (_column([point[axis] for point in points]), found.quantities[key]) for axis, key in enumerate(found.keys)
    }
    columns |= {
        "outcome": (found.outcomes.ravel(), Quantity("", "how the run ended")),
        "end_time": (found.end_times.ravel(), Quantity("s", "time at which the run ended")),
    }
    merits = found.merits
    columns |= {name: (values.ravel(), merits[name]) for name, values in found.metrics.items()}
    return FileContent(
        columns={name: values for name, (values, _) in columns.items()},
        quantities={name: quantity for name, (_, quantity) in columns.items()},
        facts={"swept": ", ".join(found.keys), "experiment": plain(leaves(found.experiment))},
    )


def _column(values: Sequence[Any]) -> np.ndarray:
    """Values as a column; of any but numbers their texts, lists without a comma, which CSV cannot hold."""
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        return np.array(values)
    return np.array([shown(value).replace(",", "") for value in values])


def as_json(found: Sweep) -> str:
    """The content as JSON: units, and an object for each run."""
    content = content_of(found)
    rows = zip(*(values.tolist() for values in content.columns.values()), strict=True)
    points = [dict(zip(found.keys, point, strict=True)) for point in product(*found.values)]
    runs = [plain(dict(zip(content.columns, row, strict=True)) | at) for row, at in zip(rows, points, strict=True)]
    return json.dumps({"keys": found.keys, "units": content.units, "runs": runs}, indent=1, allow_nan=False)


def print_sweep(found: Sweep, metrics: Sequence[str]) -> None:
    """Print figures of merit over one key, or each of them over two."""
    console = terminal()
    if len(found.keys) == 1:
        console.print(_over_one(found, metrics))
        return
    for metric in metrics:
        over = f" over {' (down) and '.join(found.keys)}"
        console.print(styled("bold", _named(metric, found.merits[metric]), over))
        console.print(_over_two(found, metric))


def _over_one(found: Sweep, metrics: Sequence[str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    (key,) = found.keys
    table.add_column(_named(key, found.quantities[key]), style="bold")
    for metric in metrics:
        table.add_column(_named(metric, found.merits[metric]), justify="right")
    for index, value in enumerate(found.values[0]):
        table.add_row(shown(value), *(_cell(found, metric, (index,)) for metric in metrics))
    return table


def _over_two(found: Sweep, metric: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold")
    for value in found.values[1]:
        table.add_column(shown(value), justify="right")
    for row, value in enumerate(found.values[0]):
        table.add_row(shown(value), *(_cell(found, metric, (row, column)) for column in range(found.shape[1])))
    return table


def _cell(found: Sweep, metric: str, index: tuple[int, ...]) -> str:
    """A figure of merit, or how the run ended."""
    outcome = str(found.outcomes[index])
    if outcome != "completed":
        return outcome.replace("_", " ")
    value = found.metrics[metric][index]
    return "–" if np.isnan(value) else f"{value:.4g}"


def shown(value: Any) -> str:
    """A value of a key."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(shown, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _named(words: str, quantity: Quantity) -> str:
    unit = readable_unit(quantity.unit)
    return f"{words} ({unit})" if unit else words
