"""What every peer is given: one experiment, as the numbers and tables of the product's own closed loop."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import ClosedLoop, closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of, zeros_of
from dualwinch.simulation.paper import case

REFERENCE = ("reference.x", "reference.v", "reference.a", "steady")
"""Columns of `Case.reference`."""


@dataclass(frozen=True)
class Case:
    """One rollout: FANDO-NFTSM in the paper's Case 4 at 1 kHz.

    Attributes:
        duration: length in s.
        integrator, substeps: the method between two samples.
    """

    duration: float = 50.0
    integrator: str = "rk4"
    substeps: int = 4

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment."""
        simulation = Simulation(
            duration=self.duration,
            integrator=self.integrator,  # pyright: ignore[reportArgumentType]
            substeps=self.substeps,
        )
        return replace(case(4, "fando-nftsm"), simulation=simulation)

    @cached_property
    def loop(self) -> ClosedLoop:
        """The symbolic closed loop, without what this case switches off."""
        structure = structure_of(self.experiment)
        return closed_loop(structure, zeros_of(structure, self.named_parameters))

    @cached_property
    def named_parameters(self) -> dict[str, float]:
        """Every number of the experiment by its key."""
        return parameters_of(self.experiment)

    @cached_property
    def parameters(self) -> NDArray[np.float64]:
        """The same numbers as the closed loop takes them."""
        return np.array(list(self.named_parameters.values()))

    @cached_property
    def exogenous(self) -> NDArray[np.float64]:
        """What each sample receives from outside, (samples, exogenous)."""
        return exogenous_signals(self.experiment)

    @cached_property
    def reference(self) -> NDArray[np.float64]:
        """The part of `exogenous` that is not zero in this case, (samples, 4): columns `REFERENCE`."""
        columns = [self.loop.exogenous.index(name) for name in REFERENCE]
        return np.ascontiguousarray(self.exogenous[:, columns])

    @cached_property
    def start(self) -> NDArray[np.float64]:
        """State of the closed loop before the first sample; its first six elements are the plant's."""
        return np.array(list(initial_state_of(self.experiment).values()))

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.experiment.samples
