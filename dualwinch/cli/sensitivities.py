"""The command ``sensitivities``: derivatives of a run by parameters, as tables, data and a figure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dualwinch.cli.options import ControllerOptions, Figure, Json
from dualwinch.cli.output import (
    FigureColumn,
    FigureTable,
    check_file,
    print_json,
    styled,
    terminal,
    write_figure,
    wrote,
)
from dualwinch.cli.progress import ProgressLine
from dualwinch.cli.sweep import checked_metrics

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dualwinch.simulation.batch.sensitivities import Sensitivities
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.simulation.results.file_formats import FileContent


def sensitivities(
    *keys: str,
    given: ControllerOptions = ControllerOptions(),
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

    Examples:
        dualwinch sensitivities "plant.vehicle.*" --case 4
        dualwinch sensitivities plant.vehicle.mass controller.observer.l0 --case 4 --metric mse --metric peak_tension
        dualwinch sensitivities "plant.rope_*.modulus" nominal.vehicle.mass --column F1 --column tau_1 --plot slopes.png
        dualwinch sensitivities "sensors.load_cell_*" --set simulation.readings=true --column F1_read --out slopes.csv
        dualwinch sensitivities "plant.winch_*.radius_error" sensors.position_bias --case 4 --json
    """
    from dualwinch.simulation.batch.sensitivities import sensitivities
    from dualwinch.simulation.prepare import check_memory
    from dualwinch.simulation.results.file_formats import FORMATS, MIXED

    base = given.experiment()
    metrics, columns = checked_metrics(metric or ["mse"], base), column or ["e"]
    values = values_of(keys, base)
    check_memory(base.samples, 1, (len(columns) + 1) * (len(values) + 1))
    check_file(out, *MIXED)
    with ProgressLine("differentiating", command="sensitivities", patient=True) as progress:
        derivatives = sensitivities(list(values), [list(values.values())], [base], columns=columns, progress=progress)
    if derivatives.interrupted:
        raise KeyboardInterrupt
    record = to_record(base, values, derivatives)
    if json:
        print_json(record)
    else:
        print_effects(record, base, derivatives, metrics)
    if out:
        FORMATS[out.suffix.lower()].write(content_of(record, base, derivatives), out)
        wrote(out)
    if plot:
        from dualwinch.simulation.batch.sensitivities import effects_figure

        write_figure(plot, lambda: effects_figure(base, changes(record, derivatives), derivatives.quantities))


def values_of(words: Sequence[str], experiment: Experiment) -> dict[str, float]:
    """Key → value of the parameters that words name; `sensitivities` refuses those without a derivative.

    Raises:
        ConfigurationError: no key, or a pattern that matches none.
    """
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.batch.sensitivities import differentiable_numbers
    from dualwinch.simulation.settings import current

    numbers = differentiable_numbers(experiment)
    selection: dict[str, float] = {}
    for word in (part.strip() for text in words for part in text.split(",")):
        key = current(word)
        matching = [name for name in numbers if fnmatchcase(name, key)] if "*" in key else [key]
        if not matching:
            raise ConfigurationError(f"{word}: matches no parameter that runs can be differentiated by")
        selection |= {name: numbers.get(name, 0.0) for name in matching}
    if not selection:
        raise ConfigurationError('give keys to differentiate by, e.g. plant.vehicle.mass or "plant.rope_*.modulus"')
    return selection


SHARE = 0.01
"""Relative step of a parameter for the first-order changes in tables and figures."""


def to_record(experiment: Experiment, values: dict[str, float], found: Sensitivities) -> dict[str, Any]:
    """Outcome, parameters, figures of merit with gradients, and largest slopes of columns, as plain data.

    The step of a parameter is a percent of its value; of a zero value, a percent of its largest bound, or 1.
    """
    import numpy as np

    from dualwinch.simulation.batch.sensitivities import described
    from dualwinch.simulation.metrics.metrics import metric_quantities

    descriptions, merits = described(experiment), metric_quantities(experiment.metrics)
    keys = {}
    for key, value in values.items():
        ends = [abs(end) for end in descriptions[key].bounds if math.isfinite(end) and end]
        step = SHARE * (abs(value) or max(ends, default=1 / SHARE))
        keys[key] = {"value": value, "unit": descriptions[key].quantity.unit, "step": step}
    steps = np.array([each["step"] for each in keys.values()])

    def by_key(numbers: NDArray[np.float64]) -> dict[str, float]:
        return dict(zip(keys, numbers.tolist(), strict=True))

    metrics, columns = {}, {}
    for name, all_values in found.metrics.items():
        value, gradient = float(all_values[0, 0]), found.gradients[name][0, 0]
        metrics[name] = {
            "value": value,
            "unit": merits[name].unit,
            "gradient": by_key(gradient),
            "change_by_step": by_key(gradient * steps),
            "relative_change_by_step": by_key(gradient / (value or math.nan) * steps),
        }
    for name, quantity in found.quantities.items():
        slopes = found.column_slopes[name][0, 0]
        samples = np.where(np.isnan(slopes), -1.0, np.abs(slopes)).argmax(axis=0)
        largest = slopes[samples, np.arange(len(samples))]
        columns[name] = {
            "unit": quantity.unit,
            "largest_slope": by_key(largest),
            "time_of_largest_slope": by_key(samples * experiment.simulation.sample_time),
            "change_by_step": by_key(largest * steps),
        }
    return {
        "outcome": str(found.outcomes[0, 0]),
        "units": {"relative_change_by_step": "1", "time_of_largest_slope": "s"},
        "keys": keys,
        "metrics": metrics,
        "columns": columns,
    }


def content_of(record: dict[str, Any], experiment: Experiment, found: Sensitivities) -> FileContent:
    """Content of the data file: time, columns, and their derivatives, ``COLUMN by KEY``."""
    import numpy as np

    from dualwinch.model.quantities.quantity import Quantity
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.simulation.results.file_formats import FileContent

    t: NDArray[np.float64] = np.arange(experiment.samples, dtype=np.float64) * experiment.simulation.sample_time
    columns = {"t": (t, Quantity("s", "nominal time of the sample"))}
    for name, quantity in found.quantities.items():
        columns.setdefault(name, (found.columns[name][0, 0], quantity))
        for (key, each), slope in zip(record["keys"].items(), found.column_slopes[name][0, 0].T, strict=True):
            unit = per(quantity.unit, each["unit"])
            columns[f"{name} by {key}"] = slope, Quantity(unit, f"derivative of {name} by {key}")
    facts = {"differentiated_by": ", ".join(record["keys"]), "experiment": leaves(experiment)}
    return FileContent.of(columns, facts)


def changes(record: dict[str, Any], found: Sensitivities) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Column → key with its step → first-order change of the column over time (samples,)."""
    return {
        column: {
            f"{key} {_cell(each['step'], each['unit'], sign='+')}": slope * each["step"]
            for (key, each), slope in zip(record["keys"].items(), slopes[0, 0].T, strict=True)
        }
        for column, slopes in found.column_slopes.items()
    }


def print_effects(record: dict[str, Any], experiment: Experiment, found: Sensitivities, metrics: Sequence[str]) -> None:
    """Print derivatives and changes of figures of merit, and the largest ones of columns."""
    from dualwinch.model.quantities.tables import readable
    from dualwinch.simulation.metrics.metrics import metric_quantities

    console, keys, merits = terminal(), record["keys"], metric_quantities(experiment.metrics)
    console.print(styled("bold", experiment.controller.law.kind, f": {record['outcome'].replace('_', ' ')}"))

    def show(name: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        columns = [FigureColumn("key", "", ""), *map(FigureColumn, ("with", *headings))]
        steps = ((key, _cell(each["step"], each["unit"], sign="+")) for key, each in keys.items())
        lines = [(*step, *row) for step, row in zip(steps, rows, strict=True)]
        console.print(FigureTable(name, columns, lines).render())

    for name in metrics:
        merit = record["metrics"][name]
        value, unit = merit["value"], merit["unit"]
        console.print(styled("bold", name, f" = {_cell(value, unit)}: {readable(merits[name].meaning)}"))
        rows = []
        for key, slope in merit["gradient"].items():
            change = merit["change_by_step"][key]
            share = (100 * change / value, "%") if value else (change, unit)
            rows.append((_cell(slope, per(unit, keys[key]["unit"])), _cell(*share, sign="+")))
        show(name, ("derivative", "changes by"), rows)
    for name, column in record["columns"].items():
        console.print(styled("bold", name, f": {readable(found.quantities[name].meaning)}"))
        rows = [
            (
                _cell(slope, per(column["unit"], keys[key]["unit"])),
                _cell(column["change_by_step"][key], column["unit"], sign="+"),
                _cell(column["time_of_largest_slope"][key], "s"),
            )
            for key, slope in column["largest_slope"].items()
        ]
        show(name, ("largest slope", "changes by", "at"), rows)


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
