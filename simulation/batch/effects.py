"""First-order effects of parameters on a run: derivatives, and the changes by one more percent of each parameter."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable, Sentence
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.sensitivities import Sensitivities, described, effects_figure
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.results.file_formats import FileContent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """A parameter with its value and its step."""

    value: float
    unit: str
    step: float

    @property
    def words(self) -> str:
        """The step with its sign and unit."""
        return with_unit(self.step, self.unit, sign="+")


@dataclass(frozen=True, eq=False)
class Effects:
    """Effects of parameters on a run.

    Attributes:
        experiment: of the run.
        values: key → value of every parameter.
        sensitivities: derivatives of that run by these parameters.
    """

    experiment: Experiment
    values: Mapping[str, float]
    sensitivities: Sensitivities

    @cached_property
    def steps(self) -> dict[str, Step]:
        """Key → step of the parameter: a percent of its value; of a zero, a percent of its largest bound, or 1."""
        descriptions, steps = described(self.experiment), {}
        for key, value in self.values.items():
            ends = [abs(end) for end in descriptions[key].bounds if math.isfinite(end) and end]
            percent = (abs(value) or max(ends, default=100.0)) / 100
            steps[key] = Step(value, descriptions[key].quantity.unit, percent)
        return steps

    def to_record(self) -> dict[str, Any]:
        """Outcome, parameters, figures of merit with gradients, and largest slopes of columns, as plain data."""
        merits, derivatives = metric_quantities(self.experiment.metrics), self.sensitivities
        steps = np.array([each.step for each in self.steps.values()])

        def by_key(numbers: Floats) -> dict[str, float]:
            return dict(zip(self.steps, numbers.tolist(), strict=True))

        metrics, columns = {}, {}
        for name, all_values in derivatives.metrics.items():
            value, gradient = float(all_values[0, 0]), derivatives.gradients[name][0, 0]
            metrics[name] = {
                "value": value,
                "unit": merits[name].unit,
                "gradient": by_key(gradient),
                "change_by_step": by_key(gradient * steps),
                "relative_change_by_step": by_key(gradient / (value or math.nan) * steps),
            }
        for name, quantity in derivatives.quantities.items():
            slopes = derivatives.column_slopes[name][0, 0]
            samples = np.where(np.isnan(slopes), -1.0, np.abs(slopes)).argmax(axis=0)
            largest = slopes[samples, np.arange(len(samples))]
            columns[name] = {
                "unit": quantity.unit,
                "largest_slope": by_key(largest),
                "time_of_largest_slope": by_key(samples * self.experiment.simulation.sample_time),
                "change_by_step": by_key(largest * steps),
            }
        return {
            "outcome": str(derivatives.outcomes[0, 0]),
            "units": {"relative_change_by_step": "1", "time_of_largest_slope": "s"},
            "keys": {key: vars(step) for key, step in self.steps.items()},
            "metrics": metrics,
            "columns": columns,
        }

    @property
    def content(self) -> FileContent:
        """Content of a data file: time, columns, and their derivatives, ``COLUMN by KEY``."""
        experiment, derivatives = self.experiment, self.sensitivities
        t: Floats = np.arange(experiment.samples, dtype=np.float64) * experiment.simulation.sample_time
        columns = {"t": (t, Quantity("s", "nominal time of the sample"))}
        for name, quantity in derivatives.quantities.items():
            columns.setdefault(name, (derivatives.columns[name][0, 0], quantity))
            for (key, step), slope in zip(self.steps.items(), derivatives.column_slopes[name][0, 0].T, strict=True):
                unit = per(quantity.unit, step.unit)
                columns[f"{name} by {key}"] = slope, Quantity(unit, f"derivative of {name} by {key}")
        facts = {"differentiated_by": ", ".join(self.steps), "experiment": leaves(experiment)}
        return FileContent.of(columns, facts)

    def plot(self) -> "Figure":
        """Draw the first-order change of every column over time."""
        changes = {
            column: {
                f"{key} {step.words}": slope * step.step
                for (key, step), slope in zip(self.steps.items(), slopes[0, 0].T, strict=True)
            }
            for column, slopes in self.sensitivities.column_slopes.items()
        }
        return effects_figure(self.experiment, changes, self.sensitivities.quantities)

    def figures(self, metrics: Sequence[str]) -> Figures:
        """Derivatives and changes of figures of merit, and the largest ones of columns."""
        record, merits = self.to_record(), metric_quantities(self.experiment.metrics)
        outcome = Sentence(f": {record['outcome'].replace('_', ' ')}", self.experiment.controller.law.kind)
        tables = []
        for name in metrics:
            merit = record["metrics"][name]
            value, unit = merit["value"], merit["unit"]
            rows = []
            for key, slope in merit["gradient"].items():
                change = merit["change_by_step"][key]
                share = (100 * change / value, "%") if value else (change, unit)
                rows.append((with_unit(slope, per(unit, self.steps[key].unit)), with_unit(*share, sign="+")))
            title = f" = {with_unit(value, unit)}: {readable(merits[name].meaning)}"
            tables.append(self._table(name, title, ("derivative", "changes by"), rows))
        for name, column in record["columns"].items():
            rows = [
                (
                    with_unit(slope, per(column["unit"], self.steps[key].unit)),
                    with_unit(column["change_by_step"][key], column["unit"], sign="+"),
                    with_unit(column["time_of_largest_slope"][key], "s"),
                )
                for key, slope in column["largest_slope"].items()
            ]
            title = f": {readable(self.sensitivities.quantities[name].meaning)}"
            tables.append(self._table(name, title, ("largest slope", "changes by", "at"), rows))
        return [outcome, *tables]

    def _table(self, name: str, subtitle: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> FigureTable:
        columns = [FigureColumn("key", "", ""), *map(FigureColumn, ("with", *headings))]
        lines = [(key, step.words, *row) for (key, step), row in zip(self.steps.items(), rows, strict=True)]
        return FigureTable(name, columns, lines, name, subtitle)


def per(unit: str, other: str) -> str:
    """The unit of a derivative, `unit` over `other`.

    Example:
        >>> per("m", "kg"), per("m", "N m"), per("m", "1")
        ('m/kg', 'm/(N m)', 'm')
    """
    if other == "1":
        return unit
    return f"{unit}/({other})" if any(sign in other for sign in " /") else f"{unit}/{other}"


def with_unit(value: float, unit: str, *, sign: str = "") -> str:
    """A number with three significant digits and its unit; a dash if it is not finite."""
    number = f"{value:{sign}.3g}" if math.isfinite(value) else "–"
    return f"{number} {readable_unit(unit)}".rstrip()
