"""Runs of an experiment over a grid of some of its values, and their figure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.quantity import Quantity, suggestion
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.simulation.batch.rollout import run_grid
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metric import MetricQuantity
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import Progress, no_progress, part
from dualwinch.simulation.results import figures
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
        return figures().sweep_figure(self, metric, ax=ax)


PREPARING = 0.3
"""Share of the time that goes into making the experiments of a large sweep."""


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
    """
    instance("experiment", experiment, Experiment)
    if not isinstance(values, Mapping):
        raise ConfigurationError(f"values: must be a dictionary of keys and values, not {type(values).__name__}")
    grid = {current(key): _listed(key, given) for key, given in values.items()}
    if "metrics" in grid:
        raise ConfigurationError("metrics: is the same for all runs of a sweep; add every metric to the experiment")
    if not grid:
        raise ConfigurationError("sweep: no key to vary; give key: values, e.g. {'controller.observer.l0': [2, 5, 10]}")
    shape = tuple(map(len, grid.values()))
    experiments = np.empty(shape, dtype=object)
    for done, (index, point) in enumerate(zip(np.ndindex(shape), product(*grid.values()), strict=True)):
        progress(PREPARING * done / experiments.size)
        experiments[index] = _point(experiment, dict(zip(grid, point, strict=True)))
    runs = run_grid(experiments, workers=workers, progress=part(progress, PREPARING, 1.0))
    edges = [experiments[(0,) * axis + (slice(None),) + (0,) * (len(shape) - axis - 1)] for axis in range(len(shape))]
    return Sweep(
        runs.outcomes,
        runs.end_times,
        runs.metrics,
        runs.interrupted,
        experiment=experiment,
        keys=tuple(grid),
        values=tuple(tuple(leaves(made)[key] for made in edge) for key, edge in zip(grid, edges, strict=True)),
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
        made = override(experiment, values)
        prepare(made)
    except ConfigurationError as error:
        message, assignments = str(error), [f"{key} = {shown(value)}" for key, value in values.items()]
        if message.startswith(("unknown key", *assignments)):
            raise
        raise ConfigurationError(f"{', '.join(assignments)}: {message}") from error
    return made
