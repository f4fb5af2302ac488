"""The command ``sensitivities``: how a run changes with its numbers, as tables, data and a figure."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from dualwinch.commands.output import check_plot, styled, terminal
from dualwinch.commands.sweep import writer
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity, nearest
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.sensitivities import Sensitivities, described, differentiable_numbers, sensitivities
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import BUILT_IN, metric_quantities
from dualwinch.simulation.prepare import check_memory
from dualwinch.simulation.results.file_formats import FileContent, plain
from dualwinch.simulation.settings import current


def run_sensitivities(
    experiment: Experiment,
    keys: Sequence[str],
    metrics: Sequence[str],
    columns: Sequence[str],
    *,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Run, print, write. Everything that can be wrong with words and files is found before the run.

    Args:
        experiment: what is run.
        keys: what to differentiate by; patterns, also separated by commas.
        metrics: figures of merit to print.
        columns: columns of the result to print, draw and write.
        out: file of the data.
        plot: file of the figure.
        json: whether JSON is printed, and no table.

    Raises:
        ConfigurationError: anything wrong with a key, a name or a file.
        KeyboardInterrupt: interrupted.
    """
    values = values_of(keys, experiment)
    known = (*BUILT_IN, *(metric.table() for metric in experiment.metrics))
    for name in metrics:
        if name not in known:
            raise ConfigurationError(f"--metric {name}: unknown metric; did you mean '{nearest(name, known)}'?")
    check_memory(experiment.samples, 1, (len(columns) + 1) * (len(values) + 1))
    write = writer(out) if out else None
    check_plot(plot)
    console = terminal(stderr=True)
    with console.status("differentiating"):
        found = sensitivities(list(values), [list(values.values())], [experiment], columns=columns)
    if found.interrupted:
        raise KeyboardInterrupt
    effects = Effects(experiment, values, found)
    if json:
        sys.stdout.write(as_json(effects) + "\n")
    else:
        print_effects(effects, metrics)
    if out and write:
        write(content_of(effects), out)
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import save as save_figure
        from dualwinch.simulation.plots.analyses import effects_figure

        save_figure(effects_figure(experiment, effects.changes(), effects.found.quantities), plot)
        console.print(f"wrote {plot}")


def values_of(words: Sequence[str], experiment: Experiment) -> dict[str, float]:
    """Key → value of the numbers that some words name; those without a derivative are left to be refused by name.

    Raises:
        ConfigurationError: none, or a word that names nothing.
    """
    known = differentiable_numbers(experiment)
    found: dict[str, float] = {}
    for word in (part.strip() for text in words for part in text.split(",")):
        key = current(word)
        matching = [name for name in known if fnmatchcase(name, key)] if "*" in key else [key]
        if not matching:
            raise ConfigurationError(f"{word}: no number that runs can be differentiated by has such a key")
        found |= {name: known.get(name, 0.0) for name in matching}
    if not found:
        raise ConfigurationError('give keys to differentiate by, e.g. plant.vehicle.mass or "plant.rope_*.modulus"')
    return found


Floats = NDArray[np.float64]

SHARE = 0.01
"""Of a number: the step by which tables and figures show what it changes, to first order."""


@dataclass(frozen=True)
class Effects:
    """How a run changes with its numbers.

    Attributes:
        experiment: what was run.
        values: key → value of the numbers.
        found: their sensitivities, of the one run.
    """

    experiment: Experiment
    values: dict[str, float]
    found: Sensitivities

    @cached_property
    def units(self) -> dict[str, str]:
        """Key → unit."""
        known = described(self.experiment)
        return {key: known[key].quantity.unit for key in self.values}

    @cached_property
    def steps(self) -> dict[str, float]:
        """Key → one more percent of its value; of one that is zero, a percent of its range, or 1."""
        known, steps = described(self.experiment), {}
        for key, value in self.values.items():
            ends = [abs(end) for end in known[key].bounds if np.isfinite(end) and end]
            steps[key] = SHARE * (abs(value) or max(ends, default=1 / SHARE))
        return steps

    def asked(self, key: str) -> tuple[str, str]:
        """A key, and its step in words, e.g. ``+100 kg``."""
        return key, _cell(self.steps[key], self.units[key], sign="+")

    def largest(self, column: str) -> list[tuple[str, float, float]]:
        """Of every key, the derivative of a column that is largest, and its time in s; NaN where there is none."""
        slopes = self.found.column_slopes[column][0, 0]
        samples = np.where(np.isnan(slopes), -1.0, np.abs(slopes)).argmax(axis=0)
        found = slopes[samples, np.arange(len(samples))]
        times = samples * self.experiment.simulation.sample_time
        return list(zip(self.values, found.tolist(), times.tolist(), strict=True))

    def changes(self) -> dict[str, dict[str, Floats]]:
        """Column → key with its step → change of the column over the time (samples,)."""
        labels, steps = [" ".join(self.asked(key)) for key in self.values], np.array(list(self.steps.values()))
        return {
            column: dict(zip(labels, (slopes[0, 0] * steps).T, strict=True))
            for column, slopes in self.found.column_slopes.items()
        }


def content_of(effects: Effects) -> FileContent:
    """What a file holds: time, columns, and the derivatives of each, ``COLUMN by KEY``."""
    found, sample_time = effects.found, effects.experiment.simulation.sample_time
    t: Floats = np.arange(effects.experiment.samples, dtype=np.float64) * sample_time
    columns = {"t": (t, Quantity("s", "nominal time of the sample"))}
    for name, quantity in found.quantities.items():
        columns.setdefault(name, (found.columns[name][0, 0], quantity))
        for key, slope in zip(effects.values, found.column_slopes[name][0, 0].T, strict=True):
            unit = per(quantity.unit, effects.units[key])
            columns[f"{name} by {key}"] = slope, Quantity(unit, f"derivative of {name} by {key}")
    return FileContent(
        columns={name: values for name, (values, _) in columns.items()},
        quantities={name: quantity for name, (_, quantity) in columns.items()},
        facts={"differentiated_by": ", ".join(effects.values), "experiment": plain(leaves(effects.experiment))},
    )


def as_json(effects: Effects) -> str:
    """Outcome, numbers, figures of merit with their gradients, and the largest slopes of columns, as JSON."""
    found, merits = effects.found, metric_quantities(effects.experiment.metrics)
    content = {
        "outcome": str(found.outcomes[0, 0]),
        "keys": {key: {"value": value, "unit": effects.units[key]} for key, value in effects.values.items()},
        "metrics": {
            name: {
                "value": float(values[0, 0]),
                "unit": merits[name].unit,
                "gradient": dict(zip(effects.values, found.gradients[name][0, 0].tolist(), strict=True)),
            }
            for name, values in found.metrics.items()
        },
        "columns": {
            name: {"unit": quantity.unit, "largest_slope": {key: slope for key, slope, _ in effects.largest(name)}}
            for name, quantity in found.quantities.items()
        },
    }
    return json.dumps(plain(content), indent=1, allow_nan=False)


def print_effects(effects: Effects, metrics: Sequence[str]) -> None:
    """Print how figures of merit change, and how far columns do at most."""
    console, found = terminal(), effects.found
    law, outcome = effects.experiment.controller.law.kind, str(found.outcomes[0, 0]).replace("_", " ")
    console.print(styled("bold", law, f": {outcome}"))
    merits = metric_quantities(effects.experiment.metrics)
    for metric in metrics:
        value, unit = float(found.metrics[metric][0, 0]), merits[metric].unit
        console.print(styled("bold", metric, f" = {_cell(value, unit)}: {readable(merits[metric].meaning)}"))
        table = _table("derivative", "changes by")
        for number, key in enumerate(effects.values):
            slope = float(found.gradients[metric][0, 0, number])
            change = slope * effects.steps[key]
            share = (100 * change / value, "%") if value else (change, unit)
            table.add_row(*effects.asked(key), _cell(slope, per(unit, effects.units[key])), _cell(*share, sign="+"))
        console.print(table)
    for column, quantity in found.quantities.items():
        console.print(styled("bold", column, f": {readable(quantity.meaning)}"))
        table = _table("largest slope", "changes by", "at")
        for key, slope, t in effects.largest(column):
            change = _cell(slope * effects.steps[key], quantity.unit, sign="+")
            table.add_row(
                *effects.asked(key), _cell(slope, per(quantity.unit, effects.units[key])), change, _cell(t, "s")
            )
        console.print(table)


def per(unit: str, other: str) -> str:
    """The unit of a derivative."""
    if other == "1":
        return unit
    return f"{unit}/({other})" if any(sign in other for sign in " /") else f"{unit}/{other}"


def _cell(value: float, unit: str, *, sign: str = "") -> str:
    number = f"{value:{sign}.3g}" if np.isfinite(value) else "–"
    return f"{number} {readable_unit(unit)}".rstrip()


def _table(*headings: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for heading in ("with", *headings):
        table.add_column(heading, justify="right")
    return table
