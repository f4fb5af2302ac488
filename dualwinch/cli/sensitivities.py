"""The command ``sensitivities``: derivatives of a run by parameters, as tables, data and a figure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cyclopts import App

from dualwinch.cli.options import CONTROLLER, ControllerOptions, Figure, Json
from dualwinch.cli.output import (
    FIGURE_SUFFIXES,
    FigureColumn,
    FigureTable,
    check_file,
    print_json,
    styled,
    terminal,
    write_figure,
    wrote,
)
from dualwinch.cli.sweep import checked_metrics

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dualwinch.simulation.batch.sensitivities import Sensitivities
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.simulation.results.file_formats import FileContent

app = App(
    name="sensitivities",
    help_epilogue="""Examples:

    dualwinch sensitivities "plant.vehicle.*" --case 4
    dualwinch sensitivities plant.vehicle.mass controller.observer.l0 --case 4 --metric mse --metric peak_tension
    dualwinch sensitivities "plant.rope_*.modulus" nominal.vehicle.mass --column F1 --column tau_1 --plot slopes.png
    dualwinch sensitivities "sensors.load_cell_*" --set simulation.readings=true --column F1_read --out slopes.csv
    dualwinch sensitivities "plant.winch_*.radius_error" sensors.position_bias --case 4 --json
""",
)


@app.default
def sensitivities(
    *keys: str,
    given: ControllerOptions = CONTROLLER,
    metric: list[str] | None = None,
    column: list[str] | None = None,
    out: Path | None = None,
    plot: Figure = None,
    json: Json = False,
) -> None:
    """Differentiate a run by parameters of plant, sensors, disturbance and controller, exactly.

    Any continuous parameter of these in `dualwinch config` may be given, and nominal.* for the controller's nominal
    model of the plant, which plant.* leaves unchanged. Random signals keep their draws, and quantised sensors are
    taken as continuous. Tables and figure show first-order changes for one more percent of each parameter.

    Args:
        keys: Keys of continuous parameters, also separated by commas; * stands for anything.
        metric: Figure of merit to show (default mse); may be repeated.
        column: Column of the result over time (default e); may be repeated.
        out: File for the columns and their derivatives: .csv, .parquet, .npz.
    """
    from dualwinch.simulation.batch.sensitivities import sensitivities
    from dualwinch.simulation.prepare import check_memory
    from dualwinch.simulation.results.file_formats import FORMATS, MIXED

    base = given.experiment()
    metrics, columns = checked_metrics(metric or ["mse"], base), column or ["e"]
    values = values_of(keys, base)
    check_memory(base.samples, 1, (len(columns) + 1) * (len(values) + 1))
    check_file(out, *MIXED)
    check_file(plot, *FIGURE_SUFFIXES)
    with terminal(stderr=True).status("differentiating"):
        found = sensitivities(list(values), [list(values.values())], [base], columns=columns)
    if found.interrupted:
        raise KeyboardInterrupt
    effects = Effects(base, values, found)
    if json:
        print_json(to_record(effects))
    else:
        print_effects(effects, metrics)
    if out:
        FORMATS[out.suffix.lower()].write(content_of(effects), out)
        wrote(out)
    if plot:
        from dualwinch.simulation.plots.analyses import effects_figure

        write_figure(plot, lambda: effects_figure(base, effects.changes(), found.quantities))


def values_of(words: Sequence[str], experiment: Experiment) -> dict[str, float]:
    """Key → value of the parameters that words name; `sensitivities` refuses those without a derivative.

    Raises:
        ConfigurationError: no key, or a pattern that matches none.
    """
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.batch.sensitivities import differentiable_numbers
    from dualwinch.simulation.settings import current

    known = differentiable_numbers(experiment)
    found: dict[str, float] = {}
    for word in (part.strip() for text in words for part in text.split(",")):
        key = current(word)
        matching = [name for name in known if fnmatchcase(name, key)] if "*" in key else [key]
        if not matching:
            raise ConfigurationError(f"{word}: matches no parameter that runs can be differentiated by")
        found |= {name: known.get(name, 0.0) for name in matching}
    if not found:
        raise ConfigurationError('give keys to differentiate by, e.g. plant.vehicle.mass or "plant.rope_*.modulus"')
    return found


SHARE = 0.01
"""Relative step of a parameter for the first-order changes in tables and figures."""


@dataclass(frozen=True)
class Effects:
    """Sensitivities of one run, and first-order changes by steps of its parameters.

    Attributes:
        experiment: of the run.
        values: key → value of the parameters.
        found: sensitivities of the one run.
    """

    experiment: Experiment
    values: dict[str, float]
    found: Sensitivities

    @cached_property
    def units(self) -> dict[str, str]:
        """Key → unit."""
        from dualwinch.simulation.batch.sensitivities import described

        known = described(self.experiment)
        return {key: known[key].quantity.unit for key in self.values}

    @cached_property
    def steps(self) -> dict[str, float]:
        """Key → step: a percent of the value; of a zero value, a percent of its largest bound, or 1."""
        import numpy as np

        from dualwinch.simulation.batch.sensitivities import described

        known, steps = described(self.experiment), {}
        for key, value in self.values.items():
            ends = [abs(end) for end in known[key].bounds if np.isfinite(end) and end]
            steps[key] = SHARE * (abs(value) or max(ends, default=1 / SHARE))
        return steps

    def by_step(self, slopes: Iterable[float]) -> dict[str, float]:
        """Key → first-order change by its step, from the derivatives (parameters,)."""
        return {key: float(slope) * self.steps[key] for key, slope in zip(self.values, slopes, strict=True)}

    def asked(self, key: str) -> tuple[str, str]:
        """A key and its step in words, e.g. ``+100 kg``."""
        return key, _cell(self.steps[key], self.units[key], sign="+")

    def largest(self, column: str) -> list[tuple[str, float, float]]:
        """The largest derivative of a column by each key, with its time in s; NaN if there is none."""
        import numpy as np

        slopes = self.found.column_slopes[column][0, 0]
        samples = np.where(np.isnan(slopes), -1.0, np.abs(slopes)).argmax(axis=0)
        found = slopes[samples, np.arange(len(samples))]
        times = samples * self.experiment.simulation.sample_time
        return list(zip(self.values, found.tolist(), times.tolist(), strict=True))

    def changes(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Column → key with its step → first-order change of the column over time (samples,)."""
        import numpy as np

        labels, steps = [" ".join(self.asked(key)) for key in self.values], np.array(list(self.steps.values()))
        return {
            column: dict(zip(labels, (slopes[0, 0] * steps).T, strict=True))
            for column, slopes in self.found.column_slopes.items()
        }


def content_of(effects: Effects) -> FileContent:
    """Content of the data file: time, columns, and their derivatives, ``COLUMN by KEY``."""
    import numpy as np

    from dualwinch.model.quantities.quantity import Quantity
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.simulation.results.file_formats import FileContent

    found, sample_time = effects.found, effects.experiment.simulation.sample_time
    t: NDArray[np.float64] = np.arange(effects.experiment.samples, dtype=np.float64) * sample_time
    columns = {"t": (t, Quantity("s", "nominal time of the sample"))}
    for name, quantity in found.quantities.items():
        columns.setdefault(name, (found.columns[name][0, 0], quantity))
        for key, slope in zip(effects.values, found.column_slopes[name][0, 0].T, strict=True):
            unit = per(quantity.unit, effects.units[key])
            columns[f"{name} by {key}"] = slope, Quantity(unit, f"derivative of {name} by {key}")
    facts = {"differentiated_by": ", ".join(effects.values), "experiment": leaves(effects.experiment)}
    return FileContent.of(columns, facts)


def to_record(effects: Effects) -> dict[str, Any]:
    """Outcome, parameters, figures of merit with gradients, and largest slopes of columns, as plain data."""
    from dualwinch.simulation.metrics.metrics import metric_quantities

    found, merits = effects.found, metric_quantities(effects.experiment.metrics)
    return {
        "outcome": str(found.outcomes[0, 0]),
        "units": {"relative_change_by_step": "1", "time_of_largest_slope": "s"},
        "keys": {
            key: {"value": value, "unit": effects.units[key], "step": effects.steps[key]}
            for key, value in effects.values.items()
        },
        "metrics": {
            name: {
                "value": float(values[0, 0]),
                "unit": merits[name].unit,
                "gradient": dict(zip(effects.values, found.gradients[name][0, 0].tolist(), strict=True)),
                "change_by_step": effects.by_step(found.gradients[name][0, 0]),
                "relative_change_by_step": effects.by_step(found.gradients[name][0, 0] / (values[0, 0] or math.nan)),
            }
            for name, values in found.metrics.items()
        },
        "columns": {
            name: {
                "unit": quantity.unit,
                "largest_slope": {key: slope for key, slope, _ in effects.largest(name)},
                "time_of_largest_slope": {key: t for key, _, t in effects.largest(name)},
                "change_by_step": effects.by_step([slope for _, slope, _ in effects.largest(name)]),
            }
            for name, quantity in found.quantities.items()
        },
    }


def print_effects(effects: Effects, metrics: Sequence[str]) -> None:
    """Print derivatives and changes of figures of merit, and the largest ones of columns."""
    from dualwinch.model.quantities.tables import readable
    from dualwinch.simulation.metrics.metrics import metric_quantities

    console, found = terminal(), effects.found
    law, outcome = effects.experiment.controller.law.kind, str(found.outcomes[0, 0]).replace("_", " ")
    console.print(styled("bold", law, f": {outcome}"))
    merits = metric_quantities(effects.experiment.metrics)

    def show(name: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        columns = [FigureColumn("key", "", ""), *map(FigureColumn, ("with", *headings))]
        table = FigureTable(
            name, columns, [(*effects.asked(key), *row) for key, row in zip(effects.values, rows, strict=True)]
        )
        console.print(table.render())

    for metric in metrics:
        value, unit = float(found.metrics[metric][0, 0]), merits[metric].unit
        console.print(styled("bold", metric, f" = {_cell(value, unit)}: {readable(merits[metric].meaning)}"))
        rows = []
        for key, slope in zip(effects.values, found.gradients[metric][0, 0].tolist(), strict=True):
            change = slope * effects.steps[key]
            share = (100 * change / value, "%") if value else (change, unit)
            rows.append((_cell(slope, per(unit, effects.units[key])), _cell(*share, sign="+")))
        show(metric, ("derivative", "changes by"), rows)
    for column, quantity in found.quantities.items():
        console.print(styled("bold", column, f": {readable(quantity.meaning)}"))
        rows = [
            (
                _cell(slope, per(quantity.unit, effects.units[key])),
                _cell(slope * effects.steps[key], quantity.unit, sign="+"),
                _cell(t, "s"),
            )
            for key, slope, t in effects.largest(column)
        ]
        show(column, ("largest slope", "changes by", "at"), rows)


def per(unit: str, other: str) -> str:
    """The unit of a derivative, `unit` over `other`."""
    if other == "1":
        return unit
    return f"{unit}/({other})" if any(sign in other for sign in " /") else f"{unit}/{other}"


def _cell(value: float, unit: str, *, sign: str = "") -> str:
    import numpy as np

    from dualwinch.model.quantities.tables import readable_unit

    number = f"{value:{sign}.3g}" if np.isfinite(value) else "–"
    return f"{number} {readable_unit(unit)}".rstrip()
