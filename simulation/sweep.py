"""Runs of an experiment over a grid of some of its values, and their figure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable
from dualwinch.model.quantities.quantity import Quantity, suggestion, unknown
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.simulation.batch.rollout import run_grid
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metric import MetricQuantity
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.plots.page import GivenAxes, new_page, scenario
from dualwinch.simulation.plots.style import BLUE, INK, LIGHT, VERMILION, law_label
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import Progress, no_progress, part
from dualwinch.simulation.results.file_formats import FileContent
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.settings import current, leaf_of, override

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(RunOutcomes):
    """Results of an experiment over a grid of some of its values.

    Attributes:
        interrupted: whether an interrupt ended the sweep; runs not started have the outcome ``not_run``.
        experiment: source of all other values.
        keys: the varied keys, one axis of the grid each.
        values: the values of each key, in the order of its axis.
        quantities: key → unit and meaning.
    """

    interrupted: bool
    experiment: Experiment
    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]
    quantities: Mapping[str, Quantity]

    @property
    def merits(self) -> dict[str, MetricQuantity]:
        """Figure of merit → its metadata."""
        return metric_quantities(self.experiment.metrics)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each key."""
        return tuple(map(len, self.values))

    def at(self, key: str, value: Any) -> Self:
        """The part of the sweep at one value of a key, whose axis is dropped.

        Raises:
            UnknownNameError: the key was not varied.
            ConfigurationError: the value was not among its values.
        """
        if key not in self.keys:
            raise UnknownNameError(f"'{key}' was not swept; {suggestion(key, self.keys)}")
        axis = self.keys.index(key)
        if value not in self.values[axis]:
            raise ConfigurationError(f"{key} = {value}: must be one of {', '.join(map(str, self.values[axis]))}")
        index = self.values[axis].index(value)
        return replace(
            self.take(index, axis),
            experiment=with_leaves(self.experiment, {key: value}),
            keys=(*self.keys[:axis], *self.keys[axis + 1 :]),
            values=(*self.values[:axis], *self.values[axis + 1 :]),
        )

    @property
    def content(self) -> FileContent:
        """Content of a data file: a row per run, with the values of the keys, outcome, end and figures of merit."""
        points = list(product(*self.values))
        columns: dict[str, tuple[NDArray[Any], Quantity]] = {
            key: (_column([point[axis] for point in points]), self.quantities[key])
            for axis, key in enumerate(self.keys)
        }
        columns |= {
            "outcome": (self.outcomes.ravel(), Quantity("", "how the run ended")),
            "end_time": (self.end_times.ravel(), Quantity("s", "time at which the run ended")),
        }
        merits = self.merits
        columns |= {name: (values.ravel(), merits[name]) for name, values in self.metrics.items()}
        return FileContent.of(columns, {"swept": ", ".join(self.keys), "experiment": leaves(self.experiment)})

    def to_record(self) -> dict[str, Any]:
        """The content as plain data: units, and a mapping for each run."""
        content = self.content
        points = [dict(zip(self.keys, point, strict=True)) for point in product(*self.values)]
        runs = [row | at for row, at in zip(content.rows, points, strict=True)]
        return {"keys": self.keys, "units": content.units, "runs": runs}

    def figures(self, metrics: Sequence[str]) -> Figures:
        """Figures of merit over one key in one table, over two keys in a table each.

        Raises:
            ConfigurationError: more than two keys.
        """
        if len(self.keys) > 2:
            raise ConfigurationError("a table shows one or two keys; `at` removes one")
        if len(self.keys) == 1:
            columns = [FigureColumn(self.keys[0], "", _named(self.keys[0], self.quantities[self.keys[0]]))]
            columns += [FigureColumn(metric, heading=_named(metric, self.merits[metric])) for metric in metrics]
            rows = [
                [in_short(value), *(self._cell(metric, (index,)) for metric in metrics)]
                for index, value in enumerate(self.values[0])
            ]
            return [FigureTable("sweep", columns, rows)]
        columns = [FigureColumn("", ""), *(FigureColumn(in_short(value)) for value in self.values[1])]
        return [
            FigureTable(
                metric,
                columns,
                [
                    [in_short(value), *(self._cell(metric, (row, column)) for column in range(self.shape[1]))]
                    for row, value in enumerate(self.values[0])
                ],
                _named(metric, self.merits[metric]),
                f" over {' (down) and '.join(self.keys)}",
            )
            for metric in metrics
        ]

    def _cell(self, metric: str, index: tuple[int, ...]) -> float | str:
        """A figure of merit, or the outcome of a run that was not completed."""
        outcome = str(self.outcomes[index])
        return float(self.metrics[metric][index]) if outcome == "completed" else outcome.replace("_", " ")

    def __repr__(self) -> str:
        axes = ", ".join(f"{key}: {len(values)}" for key, values in zip(self.keys, self.values, strict=True))
        ends = ", ".join(f"{count} {word}" for word, count in sorted(self.outcome_counts.items()))
        return f"{type(self).__name__}({axes}; {ends})"

    def plot(self, metric: str, ax: "Axes | None" = None) -> "Figure":
        """Plot a line over one key, or a heat map over two (the first along the horizontal axis).

        Axes of values spaced by a factor are logarithmic, axes of words keep their order; runs that were not completed
        are marked.

        Args:
            metric: name of a figure of merit.
            ax: axes to draw into; default: a figure of its own.

        Raises:
            UnknownNameError: an unknown figure of merit.
            ConfigurationError: more than two keys (`at` removes one), or none.
        """
        return sweep_figure(self, metric, ax=ax)


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Values as a column; other values than numbers as text, without commas for CSV."""
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        return np.array(values)
    return np.array([in_short(value).replace(",", "") for value in values])


def in_short(value: Any) -> str:
    """A value of a key as text, as in TOML, with six significant digits."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(in_short, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


Floats = NDArray[np.float64]


def sweep(
    experiment: Experiment,
    values: Mapping[str, Iterable[Any]],
    *,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> Sweep:
    """Run an experiment with every combination of some values.

    Each run is of the experiment that `override` returns. Runs of one structure share the vector lanes of `rollout`;
    figures of merit equal those of `simulate` up to the elementary functions used there.

    Args:
        experiment: source of all other values.
        values: dotted key → its values. Any key is allowed, also one that chooses a part or shapes the compiled code,
            such as ``controller.kind`` or ``simulation.delay_samples``. Each key is an axis of the grid, in this order.
        workers: number of workers on this machine, or an executor; default: one thread per core.
        progress: called from time to time with the completed fraction.

    Returns:
        Figures of merit and outcomes, as arrays of the grid's shape. After an interrupt (Ctrl-C), the runs that are
        not finished have the outcome ``not_run``.

    Raises:
        ConfigurationError: an unknown key, no values, a value given twice or out of range, or inconsistent values.
        DualwinchError: no compiler or no usable cache folder.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 1.0})
        >>> sweep = dw.sweep(run, {"plant.vehicle.mass": [9e3, 1e4, 1.1e4]})
        >>> sweep.metrics["mse"].shape
        (3,)
    """
    instance("experiment", experiment, Experiment)
    if not isinstance(values, Mapping):
        raise ConfigurationError(f"values: must be a dictionary of keys and values, not {type(values).__name__}")
    grid = {current(key): _listed(key, axis_values) for key, axis_values in values.items()}
    if "metrics" in grid:
        raise ConfigurationError("metrics: is the same for all runs of a sweep; add every metric to the experiment")
    if not grid:
        raise ConfigurationError("sweep: no key to vary; give key: values, e.g. {'controller.observer.l0': [2, 5, 10]}")
    shape = tuple(map(len, grid.values()))
    experiments = np.empty(shape, dtype=object)
    for count, (index, point) in enumerate(zip(np.ndindex(shape), product(*grid.values()), strict=True)):
        progress(0.5 * count / experiments.size)
        experiments[index] = _point(experiment, dict(zip(grid, point, strict=True)))
    runs = run_grid(experiments, workers=workers, progress=part(progress, 0.5, 1.0))
    edges = [experiments[(0,) * axis + (slice(None),) + (0,) * (len(shape) - axis - 1)] for axis in range(len(shape))]
    return Sweep(
        runs.outcomes,
        runs.end_times,
        runs.metrics,
        runs.interrupted,
        experiment=experiment,
        keys=tuple(grid),
        values=tuple(
            tuple(leaves(experiment_at)[key] for experiment_at in edge) for key, edge in zip(grid, edges, strict=True)
        ),
        quantities={key: leaf_of(key, edge[0]).quantity for key, edge in zip(grid, edges, strict=True)},
    )


def _listed(key: str, given: Iterable[Any]) -> list[Any]:
    """Values of a key, as plain Python values."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise ConfigurationError(f"{key} = {shown(given)}: must be a list of values")
    listed = [value.item() if isinstance(value, np.generic) else value for value in given]
    if not listed:
        raise ConfigurationError(f"{key}: must have at least one value")
    for index, value in enumerate(listed):
        if value in listed[:index]:
            raise ConfigurationError(f"{key} = {shown(value)}: is given twice")
    return listed


def _point(experiment: Experiment, values: Mapping[str, Any]) -> Experiment:
    """The checked experiment of a grid point."""
    try:
        experiment_at = override(experiment, values)
        prepare(experiment_at)
    except ConfigurationError as error:
        message, assignments = str(error), [f"{key} = {shown(value)}" for key, value in values.items()]
        if message.startswith(("unknown key", *assignments)):
            raise
        raise ConfigurationError(f"{', '.join(assignments)}: {message}") from error
    return experiment_at


SPAN = 10
"""Ratio of the largest to the smallest number below which the axis is linear."""

LABELLED = 9
"""Maximum number of values that each get a tick."""


@dataclass(frozen=True)
class SweptAxis:
    """Axis of a swept key.

    Attributes:
        order: indices of the values along the axis.
        positions: (n,) positions of the values in that order.
        words: tick label of each value; empty for a numeric axis.
        log: whether the axis is logarithmic.
        categorical: whether the values are categories.
    """

    order: NDArray[np.int64]
    positions: Floats
    words: tuple[str, ...]
    log: bool
    categorical: bool = False

    @property
    def edges(self) -> Floats:
        """(n + 1,) edges of the cells around the values."""
        at = np.log(self.positions) if self.log else self.positions
        if len(at) == 1:
            half = 0.5 * (abs(at[0]) or 1.0)
            inner, low_edge, high_edge = np.empty(0), at[0] - half, at[0] + half
        else:
            inner = (at[1:] + at[:-1]) / 2
            low_edge, high_edge = 2 * at[0] - inner[0], 2 * at[-1] - inner[-1]
        edges = np.concatenate(([low_edge], inner, [high_edge]))
        return np.exp(edges) if self.log else edges

    def draw(self, axes: "Axes", side: Literal["x", "y"], label: str) -> None:
        """Set scale, ticks and label of one of a panel's axes."""
        axes.set(**{f"{side}label": label} | ({f"{side}scale": "log"} if self.log else {}))
        axis = axes.xaxis if side == "x" else axes.yaxis
        if self.words:
            from matplotlib.ticker import NullLocator

            axis.set_ticks(self.positions.tolist(), self.words)
            axis.set_minor_locator(NullLocator())


def swept_axis(values: Sequence[Any]) -> SweptAxis:
    """The axis of a key's values."""
    if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        words = tuple("–" if value is None else str(value).lower() for value in values)
        order = np.arange(len(values))
        return SweptAxis(order, order.astype(float), words, log=False, categorical=True)
    order = np.argsort(values)
    positions = np.array(values, float)[order]
    words = tuple(f"{value:.4g}" for value in positions) if len(positions) <= LABELLED else ()
    return SweptAxis(order, positions, words, log=grows_by_factors(positions))


def grows_by_factors(ascending: Floats) -> bool:
    """Whether the ratios between successive numbers are more even than the differences."""
    if len(ascending) < 3 or ascending[0] <= 0 or ascending[-1] < SPAN * ascending[0]:
        return False
    factors, differences = np.diff(np.log(ascending)), np.diff(ascending)
    return bool(np.ptp(factors) / factors.mean() < np.ptp(differences) / differences.mean())


def spans_decades(values: Floats) -> bool:
    """Whether values, possibly with NaN, span so many decades that only a logarithmic scale shows them."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() >= 3 * SPAN * finite.min())


MARKS = {"diverged": "x", "left_track": ">", "not_run": "."}
"""Outcome of an incomplete run → marker."""


def sweep_figure(result: Sweep, metric: str, *, ax: GivenAxes = None) -> "Figure":
    """Draw a sweep; see `Sweep.plot`.

    Raises:
        UnknownNameError: an unknown figure of merit.
        ConfigurationError: more than two keys, or none.
    """
    if metric not in result.metrics:
        raise UnknownNameError(unknown("metric", metric, result.metrics))
    if len(result.keys) not in {1, 2}:
        raise ConfigurationError(f"a sweep of {len(result.keys)} keys cannot be drawn; at(key, value) removes one")
    axes_of_sweep = [swept_axis(values) for values in result.values]
    values, outcomes = result.metrics[metric], result.outcomes
    for dimension, axis in enumerate(axes_of_sweep):
        values, outcomes = values.take(axis.order, dimension), outcomes.take(axis.order, dimension)
    title = f"{metric} over {' and '.join(key.rsplit('.', 1)[-1] for key in result.keys)}"
    law = "" if "controller.kind" in result.keys else f"{law_label(result.experiment)}; "
    with new_page(ax, 2.6 + 0.6 * len(axes_of_sweep), title, law + scenario(result.experiment)) as page:
        (axes,) = page.panels()
        draw = _line if len(axes_of_sweep) == 1 else _map
        draw(axes, axes_of_sweep, values, _named(metric, result.merits[metric]))
        for outcome, marker in MARKS.items():
            ended = np.nonzero(outcomes == outcome)
            x, *y = (axis.positions[indices] for axis, indices in zip(axes_of_sweep, ended, strict=True))
            below = (np.full(len(x), 0.04), axes.get_xaxis_transform())
            y, transform = (y[0], axes.transData) if y else below
            label = outcome.replace("_", " ") if len(x) else None
            marked = {"marker": marker, "linestyle": "none", "color": VERMILION, "label": label}
            axes.plot(x, y, **marked, transform=transform, clip_on=len(axes_of_sweep) > 1)
        axes.set_title(readable(result.merits[metric].meaning))
        for key, axis, side in zip(result.keys, axes_of_sweep, ("x", "y"), strict=False):
            axis.draw(axes, side, _named(key, result.quantities[key]))
        page.legend()
    return page.figure


def _line(axes: "Axes", along: list[SweptAxis], values: Floats, name: str) -> None:
    (axis,) = along
    line = "none" if axis.categorical else "-"
    axes.plot(axis.positions, values, marker="o", markersize=4, linestyle=line, color=BLUE)
    axes.set(ylabel=name, yscale="log" if spans_decades(values) else "linear")
    if axis.categorical:
        axes.set_xlim(-0.5, len(axis.positions) - 0.5)


def _map(axes: "Axes", along: list[SweptAxis], values: Floats, name: str) -> None:
    from matplotlib.colors import LogNorm, Normalize

    across, up = along
    axes.grid(visible=False)
    axes.set(facecolor=LIGHT, xlim=across.edges[[0, -1]], ylim=up.edges[[0, -1]])
    if not np.isfinite(values).any():
        return
    scale = (LogNorm if spans_decades(values) else Normalize)(np.nanmin(values), np.nanmax(values))
    cells = axes.pcolormesh(across.edges, up.edges, values.T, norm=scale, cmap="viridis")
    bar = axes.figure.colorbar(cells, ax=axes, label=name)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]  # the stub has no Spine here
    if across.words and up.words:  # few values
        for i, j in zip(*np.nonzero(np.isfinite(values)), strict=True):
            colour = "white" if scale(values[i, j]) < 0.6 else INK
            centred = {"ha": "center", "va": "center", "color": colour, "size": 7}
            axes.text(float(across.positions[i]), float(up.positions[j]), f"{values[i, j]:.3g}", **centred)


def _named(words: str, quantity: Quantity) -> str:
    unit = readable_unit(quantity.unit)
    return f"{words} ({unit})" if unit else words
