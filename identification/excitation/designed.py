"""A motion that makes numbers visible, and what to expect of its log."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.unknowns import Unknown
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Designed:
    """A motion that makes numbers visible.

    Attributes:
        experiment: with the motion as its reference; its rows hold what the sensors say.
        unknowns: what is to be fitted.
        covariance: (p, p) of the estimates' errors to expect, with what is known beforehand.
        present: the same of the motion there was before; None: its run does not come to its end.
        criterion: ``D`` or ``A``.
        duration: of the run in s.
        tried: motions that were simulated.
        seed: of the search.
        seconds: wall time.
    """

    experiment: Experiment
    unknowns: tuple[Unknown, ...]
    covariance: Floats
    present: Floats | None
    criterion: str
    duration: float
    tried: int
    seed: int
    seconds: float

    @property
    def keys(self) -> tuple[str, ...]:
        """What is to be fitted."""
        return tuple(unknown.key for unknown in self.unknowns)

    @property
    def deviations(self) -> Floats:
        """(p,) standard deviations to expect."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def present_deviations(self) -> Floats:
        """(p,) the same of the motion there was before; NaN: it tells nothing."""
        return np.full(len(self.keys), np.nan) if self.present is None else np.sqrt(np.diag(self.present))

    @property
    def headline(self) -> str:
        """What it is, in a line."""
        return f"the best of {self.tried} motions of {self.duration:g} s, {self.criterion}-criterion, seed {self.seed}"

    @property
    def motion(self) -> str:
        """The motion in a line."""
        reference = self.experiment.reference
        points = ", ".join(f"{point:g}" for point in reference.points)
        return f"way-points {points} m at up to {reference.speed:g} m/s and {reference.acceleration:g} m/s^2"
