"""Sets of parameters in scenarios: what a compiled rollout needs of each pair."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.signals.signals import Signals
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.request import check_batch
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.exogenous.signals import exogenous_signals, exogenous_source
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import absent_signals, closed_loop
from dualwinch.simulation.loop.start import starts
from dualwinch.simulation.loop.structure import parameters_of, structure_of, zeros_of
from dualwinch.simulation.metrics.metric import Metric

Floats = NDArray[np.float64]


class Pairs:
    """Every set of parameters (n) with every scenario (m).

    Attributes:
        names: keys of the parameters that vary.
        values: (n, names).
        experiments: of the scenarios.
        structure, loop: the closed loop of them all.
        zeros: parameters and signals that are zero in all scenarios and do not vary; the loop leaves them out.
        indices: (set, scenario) of all pairs, a scenario's together; (pairs, 2).
    """

    def __init__(self, names: Sequence[str], parameters: ArrayLike, scenarios: Sequence[Experiment | Scenario]) -> None:
        """Check that everything goes together.

        Raises:
            ConfigurationError: an unknown name, a wrong shape, a value out of range, or scenarios that do not go
                together.
        """
        self.names, self.values = tuple(names), np.asarray(parameters, float)
        self.experiments = [given.experiment if isinstance(given, Scenario) else given for given in scenarios]
        check_batch(self.names, self.values, scenarios)
        believed = [given.nominal if isinstance(given, Scenario) else None for given in scenarios]
        numbers = [parameters_of(*pair) for pair in zip(self.experiments, believed, strict=True)]
        drawn = {key for given in scenarios if isinstance(given, Scenario) for key in given.draws}
        self.structure = structure_of(self.experiments[0])
        self.zeros = zeros_of(self.structure, *numbers, varying=[*names, *drawn])
        self.zeros |= absent_signals(*self.experiments)
        self.loop = closed_loop(self.structure, self.zeros)
        self.columns = [self.loop.parameters.index(name) for name in names]
        self.indices = np.array([(i, j) for j in range(len(scenarios)) for i in range(len(self.values))])
        self._vectors = np.array([self.loop.vector(values) for values in numbers])

    @property
    def shape(self) -> tuple[int, int]:
        """(n, m)."""
        return len(self.values), len(self.experiments)

    @property
    def samples(self) -> int:
        """Samples of every run."""
        return self.experiments[0].samples

    @property
    def sample_time(self) -> float:
        """Sampling period in s."""
        return self.experiments[0].simulation.sample_time

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
        return tuple(with_leaves(metric, numbers, "metrics.") for metric in self.experiments[0].metrics)

    def vectors(self, indices: NDArray[np.int64]) -> Floats:
        """All parameters of some pairs as the loop takes them, (pairs, parameters)."""
        sets, scenarios = indices.T
        vectors = self._vectors[scenarios]
        vectors[:, self.columns] = self.values[sets]
        return vectors

    def starts(self, vectors: Floats) -> Floats:
        """States before the first sample (pairs, states) of the parameters (pairs, parameters)."""
        return starts(self.structure, vectors)

    def sources(self, scenarios: Iterable[int]) -> list[Signals]:
        """What runs of some scenarios receive from outside, drawn while they run; the same for the same scenario."""
        chosen = list(scenarios)
        made = {j: exogenous_source(self.experiments[j]) for j in set(chosen)}
        return [made[j] for j in chosen]

    def signals(self, j: int) -> Floats:
        """The same of a scenario drawn ahead, (samples, exogenous)."""
        return exogenous_signals(self.experiments[j])
