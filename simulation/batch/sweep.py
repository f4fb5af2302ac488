"""Runs over a grid of values: what came of each, as arrays of the grid's shape."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.quantity import Quantity, nearest
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.batch.scenarios import families
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.metrics.metric import MetricQuantity
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.results.outcomes import RunOutcomes, not_run
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Runs(RunOutcomes):
    """What came of experiments in a grid; every array has the grid's shape.

    Attributes:
        interrupted: whether an interrupt ended the runs; those it left out have the outcome ``not_run``.
    """

    interrupted: bool


@dataclass(frozen=True, eq=False, repr=False)
class Grid(Runs):
    """What came of an experiment over a grid of some of its values.

    Attributes:
        experiment: what all other values are from.
        keys: what was varied, an axis of the grid each.
        values: the values of each key, in its axis' order.
        quantities: key → unit and meaning.
    """

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
            raise UnknownNameError(f"'{key}' was not swept; did you mean '{nearest(key, self.keys)}'?")
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


def run_grid(
    experiments: NDArray[np.object_],
    *,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Runs:
    """Run experiments, side by side in vector lanes those that are of one structure, length and sample time.

    Args:
        experiments: an `Experiment` each, or a `Scenario`, in any shape.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        The runs; an interrupt (Ctrl-C) leaves what is finished, and ``not_run`` for the rest.

    Raises:
        ConfigurationError: the values of an experiment do not fit together.
        DualwinchError: no compiler, or no usable cache folder.
    """
    flat: Sequence[Experiment | Scenario] = experiments.ravel().tolist()
    groups: dict[Any, list[int]] = {}
    for family in families(flat):
        experiment = family.experiment
        alike = structure_of(experiment), experiment.samples, experiment.simulation.sample_time
        groups.setdefault(alike, []).extend(family.members.tolist())
    found = not_run([len(flat)], ())
    done, interrupted = 0, False
    for indices in groups.values():

        def report(share: float, before: int = done, count: int = len(indices)) -> None:
            if progress:
                progress((before + share * count) / len(flat))

        batch: BatchResult = rollout(
            [], np.empty((1, 0)), [flat[index] for index in indices], threads=threads, progress=report
        )
        found.outcomes[indices], found.end_times[indices] = batch.outcomes[0], batch.end_times[0]
        for name, values in batch.metrics.items():
            found.metrics.setdefault(name, np.full(len(flat), np.nan))[indices] = values[0]
        done += len(indices)
        interrupted = batch.interrupted
        if interrupted:
            break
    return Runs(**vars(found.reshape(experiments.shape)), interrupted=interrupted)
