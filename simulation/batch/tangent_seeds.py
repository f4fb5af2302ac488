"""What runs are differentiated by, as the compiled rollout takes it: directions in parameters, slopes of signals."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.differentiable import check_differentiable
from dualwinch.simulation.batch.family import Scenarios, experiment_of
from dualwinch.simulation.batch.pairs import Pairs
from dualwinch.simulation.batch.request import check_shape
from dualwinch.simulation.check import check
from dualwinch.simulation.exogenous.signal_slopes import check_shaped, shaped_by, signal_slope
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import described_parameters, structure_of

Floats = NDArray[np.float64]


class TangentSeeds:
    """Numbers that vary, of sets (n) in scenarios (m): those the loop takes, and those that shape signals ahead of it.

    Attributes:
        names: keys of the numbers, p of them.
        pairs: what the loop takes of every pair.
        signals: names of the signals that some of the numbers shape.
    """

    def __init__(self, names: Sequence[str], parameters: ArrayLike, scenarios: Scenarios) -> None:
        """Check that everything goes together.

        Raises:
            ConfigurationError: as by `Pairs`, or there is no derivative by a number.
        """
        self.names, self._values = tuple(names), np.asarray(parameters, float)
        if not names:
            raise ConfigurationError("names: must be at least one number to differentiate by")
        check_shape(self.names, self._values)
        taken = names
        if scenarios:
            first = experiment_of(scenarios[0])
            check_differentiable(names, first)
            loop = described_parameters(structure_of(first))
            taken = [name for name in names if name in loop or not shaped_by(name)]
        self.pairs = Pairs(taken, self._values[:, [self.names.index(name) for name in taken]], scenarios)
        self._shaped = {name: signals for name in self.names if (signals := shaped_by(name))}
        self.signals = tuple(dict.fromkeys(signal for signals in self._shaped.values() for signal in signals))
        if self._shaped:
            for i, j in self.pairs.indices.tolist():
                self._check(i, j)

    def _check(self, i: int, j: int) -> None:
        try:
            check(experiment := self._receiving(i, j))
            for name in self._shaped:
                check_shaped(experiment, name)
        except ConfigurationError as error:
            raise ConfigurationError(f"parameters[{i}]: {error}") from error

    def _receiving(self, i: int, j: int) -> Experiment:
        """The experiment whose signals a pair receives."""
        values = dict(zip(self.names, self._values[i].tolist(), strict=True))
        return with_leaves(self.pairs.experiment(j), {name: values[name] for name in self._shaped})

    def outside(self, i: int, j: int) -> Floats:
        """What a pair receives from outside, (samples, exogenous)."""
        return exogenous_signals(self._receiving(i, j)) if self._shaped else self.pairs.signals(j)

    def directions(self, chosen: range, width: int) -> Floats:
        """Directions in what the loop takes, (its numbers, width): those of some of the names, the others 0."""
        directions = np.zeros((len(self.pairs.names), width))
        for column, number in enumerate(chosen):
            if self.names[number] in self.pairs.names:
                directions[self.pairs.names.index(self.names[number]), column] = 1.0
        return directions

    def moved(self, i: int, j: int, chosen: range, width: int) -> Floats:
        """Slopes of the signals by some of the names, (samples, signals, width)."""
        moved = np.zeros((self.pairs.samples, len(self.signals), width))
        for column, number in enumerate(chosen):
            for signal in self._shaped.get(self.names[number], ()):
                slope = signal_slope(self._receiving(i, j), signal, self.names[number])
                moved[:, self.signals.index(signal), column] = slope
        return moved
