"""Sets of parameters in scenarios: what a compiled rollout needs of each pair."""

from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.quantity import with_leaves
from simulation.batch_check import check_batch
from simulation.closed_loop import closed_loop, initial_state_of
from simulation.ensemble import Scenario
from simulation.experiment import Experiment
from simulation.kept_signals import KEPT, signals
from simulation.structure import parameters_of, structure_of, zeros_of

Floats = NDArray[np.float64]

SHAPE_THE_START = ("plant.", "sensors.", "controller.coordination.")
"""Parameters that the initial state depends on: the ropes' stretch at rest, and how the encoders read it."""


class Pairs:
    """Every set of parameters (n) with every scenario (m).

    Attributes:
        names: keys of the parameters that vary.
        values: (n, names).
        experiments: of the scenarios.
        loop: the closed loop of them all.
        zeros: parameters that are zero in all scenarios and do not vary; the loop leaves out what they multiply.
        indices: (set, scenario) of all pairs, a scenario's together.
    """

    def __init__(self, names: Sequence[str], parameters: ArrayLike, scenarios: Sequence[Experiment | Scenario]) -> None:
        """Check that everything goes together.

        Raises:
            ConfigurationError: an unknown name, a wrong shape, a value out of range, or scenarios that do not go
                together.
        """
        self.names, self.values = tuple(names), np.asarray(parameters, float)
        self.experiments = [one.experiment if isinstance(one, Scenario) else one for one in scenarios]
        check_batch(self.names, self.values, scenarios)
        believed = [one.nominal if isinstance(one, Scenario) else None for one in scenarios]
        numbers = [parameters_of(one, nominal) for one, nominal in zip(self.experiments, believed, strict=True)]
        drawn = {key for one in scenarios if isinstance(one, Scenario) for key in one.draws}
        self.zeros = zeros_of(*numbers, varying=[*names, *drawn])
        self.loop = closed_loop(structure_of(self.experiments[0]), self.zeros)
        self.places = [self.loop.parameters.index(name) for name in names]
        self.indices = [(i, j) for j in range(len(scenarios)) for i in range(len(self.values))]
        self._vectors = np.array([list(one.values()) for one in numbers])
        self._shaping = [place for place, name in enumerate(names) if name.startswith(SHAPE_THE_START)]
        keys = [names[place] for place in self._shaping]
        self._start = lru_cache(maxsize=KEPT)(partial(_start_of, self.experiments, keys))

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

    def vector(self, i: int, j: int) -> Floats:
        """All parameters of a pair, as the loop takes them."""
        vector = self._vectors[j].copy()
        vector[self.places] = self.values[i]
        return vector

    def start(self, i: int, j: int) -> Floats:
        """State of a pair before the first sample."""
        return self._start(j, tuple(self.values[i, self._shaping].tolist())).copy()

    def signals(self, j: int) -> Floats:
        """What a scenario's runs receive from outside, (samples, exogenous); not to be written to."""
        return signals(self.experiments[j])


def _start_of(experiments: Sequence[Experiment], keys: Sequence[str], j: int, values: tuple[float, ...]) -> Floats:
    changes = dict(zip(keys, values, strict=True))
    return np.array(list(initial_state_of(with_leaves(experiments[j], changes)).values()))
