"""How far readings and what is unrecorded stray: what a filter takes for granted, and a fit finds out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.noise import first_noise
from dualwinch.identification.unrecorded import Scatter, described
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Levels:
    """How far readings and the unrecorded stray.

    Attributes:
        noise: (readings,) variances of the sensors.
        scatter: of what is unrecorded.
    """

    noise: Floats
    scatter: Mapping[str, Scatter]

    def scattered(self, scatter: Mapping[str, Scatter]) -> "Levels":
        """The same where some of the unrecorded strays otherwise."""
        return replace(self, scatter={**self.scatter, **scatter})


def first_levels(readings: Floats, experiment: Experiment) -> Levels:
    """Noise and scatter to begin with, by (samples, readings) of a log and what an experiment says."""
    return Levels(first_noise(readings, experiment.sensors), described(experiment))
