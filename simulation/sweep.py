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
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results import figures
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.settings import current, leaf_of, override

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(RunOutcomes):
    """What came of an experiment over a grid of some of its values.

    Attributes:
        interrupted: whether an interrupt ended the runs; those it left out have the outcome ``not_run``.
        experiment: what all other values are from.
        keys: what was varied, an axis of the grid each.
        values: the values of each key, in its axis' order.
        quantities: key → unit and meaning.
    """

    interrupted: bool
    experiment: Experiment
    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]
    quantities: Mapping[str, Quantity]

    @property
    def merits(self) -> dict[str, MetricQuantity]:
        """Figure of merit → what it is."""
        return metric_quantities(self.experiment.metrics)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each key."""
        return tuple(map(len, self.values))

    def at(self, key: str, value: Any) -> Self:
        """The part of the sweep with one value of a key, which is no axis any more.

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
        """A line over one key, or a heat map over two (the first along the horizontal axis).

        Axes of values that grow by factors are logarithmic, words stand in their order; runs that were not completed
        are marked.

        Args:
            metric: name of a figure of merit.
            ax: axes to draw into; default: a figure of its own.

        Raises:
            UnknownNameError: there is no such figure of merit.
            ConfigurationError: there are more than two keys (`at` takes one away), or none.
        """
        return figures().ensembles.sweep_figure(self, metric, ax=ax)


def sweep(
    experiment: Experiment,
    values: Mapping[str, Iterable[Any]],
    *,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> Sweep:
    """Run an experiment with every combination of some values.

    Each run is that of `override`: its figures of merit are `simulate`'s up to the elementary functions of
    `rollout`, in whose vector lanes runs of one structure go side by side.

    Args:
        experiment: where the other values come from.
        values: dotted key → its values; of any keys, those too that choose parts or shape the compiled code, such as
            ``controller.kind`` and ``simulation.delay_samples``. Each key is an axis of the grid, in this order.
        workers: of this machine, or an executor; default: one thread a core.
        progress: called now and then with the share that is done.

    Returns:
        Figures of merit and outcomes, as arrays of the grid's shape. An interrupt (Ctrl-C) leaves what is finished,
        and ``not_run`` for the rest.

    Raises:
        ConfigurationError: an unknown key, no values, a value twice or out of range, or values that do not go together.
        DualwinchError: no compiler, or no usable cache folder.
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
    for index, point in zip(np.ndindex(shape), product(*grid.values()), strict=True):
        experiments[index] = _point(experiment, dict(zip(grid, point, strict=True)))
    runs = run_grid(experiments, workers=workers, progress=progress)
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
    """Values of a key, as Python's own."""
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
    """The experiment of a point of the grid, checked."""
    try:
        made = override(experiment, values)
        prepare(made)
    except ConfigurationError as error:
        said, assignments = str(error), [f"{key} = {shown(value)}" for key, value in values.items()]
        if said.startswith(("unknown key", *assignments)):
            raise
        raise ConfigurationError(f"{', '.join(assignments)}: {said}") from error
    return made
