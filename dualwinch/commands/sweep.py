"""The command ``sweep``: an experiment over values of one or two keys, its tables, its data and its figure.

The module does not bear the command's name: that is the function ``dualwinch.sweep``, which does the work.
"""

import json
import re
import sys
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from dualwinch.commands.output import check_folder, check_plot, numbers_between, styled, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.config.toml_text import parse_assignment
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity, nearest
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.results.file_formats import FORMATS, FileContent, plain
from dualwinch.simulation.sweep import Sweep, sweep

SUFFIXES = (".csv", ".parquet", ".npz")
"""Formats that hold words beside numbers."""


def run_sweep(
    experiment: Experiment,
    over: Sequence[str],
    metrics: Sequence[str],
    *,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Run, print, write. Everything that can be wrong with words and files is found before the runs.

    Args:
        experiment: where all other values come from.
        over: keys and values, as for `axes_from`.
        metrics: figures of merit to print; the figure shows the first.
        out: file of the data.
        plot: file of the figure.
        json: whether JSON is printed, and no table.

    Raises:
        ConfigurationError: anything wrong with a key, a value, a name or a file.
        KeyboardInterrupt: interrupted; what was finished is printed and written.
    """
    axes = axes_from(over)
    known = (*BUILT_IN, *(metric.table() for metric in experiment.metrics))
    for name in metrics:
        if name not in known:
            raise ConfigurationError(f"--metric {name}: unknown metric; did you mean '{nearest(name, known)}'?")
    write = writer(out) if out else None
    check_plot(plot)
    console = terminal(stderr=True)
    with ProgressLine("simulating") as progress:
        found = sweep(experiment, axes, progress=progress)
    if json:
        sys.stdout.write(as_json(found) + "\n")
    else:
        print_sweep(found, metrics)
    if out and write:
        write(content_of(found), out)
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import save as save_figure

        save_figure(found.plot(metrics[0]), plot)
        console.print(f"wrote {plot}")
    if found.interrupted:
        raise KeyboardInterrupt


def writer(out: Path) -> Callable[[FileContent, Path], None]:
    """What writes a file of words and numbers.

    Raises:
        ConfigurationError: unknown suffix, or a folder that cannot be written to.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(f"{out.name}: unknown suffix {out.suffix!r}; must be one of {', '.join(SUFFIXES)}")
    check_folder(out.parent)
    return FORMATS[out.suffix.lower()].write


MOST_KEYS = 2
"""Keys that a table or a figure can show."""


def axes_from(texts: Sequence[str]) -> dict[str, list[Any]]:
    """Key → values of some texts.

    Args:
        texts: each ``key=value,value``, ``key=first:last:step``, ``key=first:last:count:log`` or, as in TOML,
            ``key=[value, value]``.

    Raises:
        ConfigurationError: none, more than two, one key twice, or a text that is none of these.
    """
    if not 1 <= len(texts) <= MOST_KEYS:
        raise ConfigurationError(
            f"give one or two keys with values, e.g. controller.observer.l0=1:20:1, not {len(texts)}"
        )
    found: dict[str, list[Any]] = {}
    for text in texts:
        key, equals, values = (word.strip() for word in text.partition("="))
        if not (key and equals and values):
            raise ConfigurationError(
                f"{text!r}: must be key=value,value or key=first:last:step, e.g. controller.observer.l0=1:20:1"
            )
        if key in found:
            raise ConfigurationError(f"{key}: is given twice")
        found[key] = _values(key, values)
    return found


def _values(key: str, text: str) -> list[Any]:
    if text.startswith("["):
        listed = parse_assignment(f"{key}={text}")[1]
        if not isinstance(listed, list):
            raise ConfigurationError(f"{key}={text}: must be a list as in TOML, e.g. {key}=[1, 2]")
        return listed
    if re.match(r"[\d.+-][^,]*:", text):
        wrong = f"{key}={text}: must be first:last:step or first:last:count:log, e.g. {key}=1:9:2"
        return [*numbers_between(text, wrong)]
    return [parse_assignment(f"{key}={word}")[1] for word in text.split(",")]


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
