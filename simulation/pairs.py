"""Sets of parameters in scenarios: what a compiled rollout needs of each pair."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from controllers.controller import Controller
from model.quantity import nearest, with_leaves
from simulation.check import check
from simulation.closed_loop import closed_loop, initial_state_of
from simulation.ensemble import Scenario
from simulation.environment import exogenous_signals
from simulation.errors import ConfigurationError
from simulation.experiment import Experiment
from simulation.structure import parameters_of, structure_of, zeros_of

Floats = NDArray[np.float64]

SIGNALS_KEPT = 64
"""Scenarios whose signals are kept from call to call; 4 MB each for 50 s at 1 kHz."""

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
            ConfigurationError: an unknown name, a wrong shape, or scenarios of different structure or length.
        """
        self.names, self.values = tuple(names), np.asarray(parameters, float)
        self.experiments = [one.experiment if isinstance(one, Scenario) else one for one in scenarios]
        _check_pairs(self.names, self.values, self.experiments)
        believed = [one.nominal if isinstance(one, Scenario) else None for one in scenarios]
        numbers = [parameters_of(one, nominal) for one, nominal in zip(self.experiments, believed, strict=True)]
        self.zeros = zeros_of(*numbers) - set(names)
        self.loop = closed_loop(structure_of(self.experiments[0]), self.zeros)
        self.places = [self.loop.parameters.index(name) for name in names]
        self.indices = [(i, j) for j in range(len(scenarios)) for i in range(len(self.values))]
        self._vectors = np.array([list(one.values()) for one in numbers])
        self._shaping = [place for place, name in enumerate(names) if name.startswith(SHAPE_THE_START)]
        self._start = lru_cache(maxsize=SIGNALS_KEPT)(self._start_of)

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

    def _start_of(self, j: int, chosen: tuple[float, ...]) -> Floats:
        changes = dict(zip([self.names[place] for place in self._shaping], chosen, strict=True))
        return np.array(list(initial_state_of(with_leaves(self.experiments[j], changes)).values()))

    def signals(self, j: int) -> Floats:
        """What a scenario's runs receive from outside, (samples, exogenous); not to be written to."""
        return signals(self.experiments[j])


def signals(experiment: Experiment) -> Floats:
    """The signals of an experiment (`exogenous_signals`), kept for the next call; not to be written to.

    They do not depend on the controller: all controllers share those of a scenario.
    """
    return _signals(replace(experiment, controller=Controller()))


@lru_cache(maxsize=SIGNALS_KEPT)
def _signals(experiment: Experiment) -> Floats:
    return exogenous_signals(experiment)


def _check_pairs(names: Sequence[str], values: Floats, scenarios: Sequence[Experiment]) -> None:
    if not scenarios:
        raise ConfigurationError("scenarios: must be at least one experiment")
    known = parameters_of(scenarios[0])
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown parameter '{name}'; did you mean '{nearest(name, known)}'?")
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ConfigurationError(f"parameters: shape {values.shape} must be (n, {len(names)}), a column for each name")
    first = scenarios[0]
    for number, scenario in enumerate(scenarios):
        check(scenario)
        if structure_of(scenario) != structure_of(first) or scenario.samples != first.samples:
            raise ConfigurationError(f"scenarios[{number}]: must have the structure and the length of scenarios[0]")
