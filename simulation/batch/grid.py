"""The parameter–scenario grid: every set of parameters with every scenario, as a compiled rollout takes each pair."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.signals.signals import Signals
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.scenarios import Scenarios, check_batch, experiment_of
from dualwinch.simulation.exogenous.signals import exogenous_signals, exogenous_sources
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import absent_signals, closed_loop, starts
from dualwinch.simulation.loop.structure import structure_of, zeros_of
from dualwinch.simulation.metrics.metric import Metric

Floats = NDArray[np.float64]


class ParameterScenarioGrid:
    """Every set of parameters (n) with every scenario (m).

    Attributes:
        names: keys of the parameters that vary.
        values: (n, names).
        shared: an experiment of their length, sample time, engine and metrics.
        structure, loop: the closed loop of them all.
        zeros: parameters and signals that are zero in all scenarios and do not vary; the loop leaves them out.
        indices: (set, scenario) of all pairs, a scenario's together; (pairs, 2).
    """

    def __init__(
        self,
        names: Sequence[str],
        parameters: ArrayLike,
        scenarios: Scenarios,
        zeros: frozenset[str] | None = None,
    ) -> None:
        """Check that everything goes together.

        Args:
            names: keys of the parameters that vary.
            parameters: (n, names).
            scenarios: m of them.
            zeros: those of a larger grid that this is a part of, so that both run the same compiled code; default:
                those of this one.

        Raises:
            ConfigurationError: an unknown name, a wrong shape, a value out of range, or scenarios that do not go
                together.
        """
        self.names, self.values = tuple(names), np.asarray(parameters, float)
        self._scenarios = scenarios
        self._groups = groups = check_batch(self.names, self.values, scenarios)
        self.shared = groups[0].experiment
        drawn = frozenset[str]().union(*(group.drawn for group in groups))
        there = {key for group in groups for key, column in group.columns.items() if column.any()}
        self.structure = structure_of(self.shared)
        if zeros is None:
            zeros = zeros_of(self.structure, *(group.numbers for group in groups), varying=[*names, *drawn])
            zeros |= absent_signals(*(group.experiment for group in groups), varying=there)
        self.zeros = zeros
        self.loop = closed_loop(self.structure, self.zeros)
        self.columns = [self.loop.parameters.index(name) for name in names]
        self.indices = np.array([(i, j) for j in range(len(scenarios)) for i in range(len(self.values))])
        self._vectors = np.empty((len(scenarios), len(self.loop.parameters)))
        self.beginnings = np.empty(len(scenarios))  # in m
        self._at = np.empty((len(scenarios), 2), np.int64)  # group, and number in it
        for number, group in enumerate(groups):
            self.loop.vector(group.numbers)
            self._vectors[group.members], self.beginnings[group.members] = (
                group.vectors,
                group.experiment.reference.start,
            )
            self._at[group.members] = np.stack(np.broadcast_arrays(number, np.arange(len(group.members))), axis=1)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, m)."""
        return len(self.values), len(self._scenarios)

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The scenarios' own metrics; numbers of theirs that are not the same in all pairs broadcast to (n, m)."""
        numbers: dict[str, float | Floats] = {}
        for index, name in enumerate(self.loop.parameters):
            if not name.startswith("metrics."):
                continue
            given = self._vectors[:, index]
            numbers[name] = float(given[0]) if (given == given[0]).all() else given[np.newaxis]
            if name in self.names:
                numbers[name] = self.values[:, [self.names.index(name)]]
        return tuple(with_leaves(metric, numbers, "metrics.") for metric in self.shared.metrics)

    def portions(self, size: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Parts of about so many pairs: numbers of sets, and of scenarios, all pairs of which are one part."""
        sets, scenarios = self.shape
        together = max(1, size // sets)
        for scene in range(0, scenarios, together):
            for first in range(0, sets, size):
                yield np.arange(first, min(first + size, sets)), np.arange(scene, min(scene + together, scenarios))

    def part(
        self, sets: NDArray[np.int64], scenarios: NDArray[np.int64]
    ) -> tuple[tuple[str, ...], Floats, Scenarios, frozenset[str]]:
        """What a grid of some of the sets and scenarios is made of."""
        return self.names, self.values[sets], [self._scenarios[j] for j in scenarios.tolist()], self.zeros

    def vectors(self, indices: NDArray[np.int64]) -> Floats:
        """All parameters of some pairs as the loop takes them, (pairs, parameters)."""
        sets, scenarios = indices.T
        vectors = self._vectors[scenarios]
        vectors[:, self.columns] = self.values[sets]
        return vectors

    def starts(self, vectors: Floats, scenarios: ArrayLike) -> Floats:
        """States before the first sample (pairs, states) of parameters (pairs, parameters) in scenarios (pairs,)."""
        return starts(self.structure, vectors, self.beginnings[np.asarray(scenarios)])

    def sources(self, scenarios: Iterable[int]) -> list[Signals]:
        """What runs of some scenarios receive from outside, drawn while they run; the same for the same scenario."""
        chosen = np.array(list(scenarios))
        made: dict[int, Signals] = {}
        for number in set(self._at[chosen, 0].tolist()):
            group = self._groups[number]
            members = np.unique(self._at[chosen[self._at[chosen, 0] == number], 1])
            columns = {key: column[members] for key, column in group.columns.items()}
            sources = exogenous_sources(group.experiment, columns, len(members))
            made |= zip(group.members[members].tolist(), sources, strict=True)
        return [made[j] for j in chosen.tolist()]

    def experiment(self, j: int) -> Experiment:
        """What is simulated in a scenario."""
        return experiment_of(self._scenarios[j])

    def signals(self, j: int) -> Floats:
        """What runs of a scenario receive, drawn ahead, (samples, exogenous)."""
        return exogenous_signals(self.experiment(j))
