"""What logs say of a machine."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.blind import Blind
from dualwinch.identification.force import Force
from dualwinch.identification.optima import Optimum
from dualwinch.identification.profile import Profile
from dualwinch.identification.surprises import Whiteness
from dualwinch.identification.unknowns import Unknown
from dualwinch.identification.unrecorded import Scatter
from dualwinch.simulation.ensembles.distributions import Choice
from dualwinch.simulation.ensembles.ensemble import Drawn, Ensemble
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

DRAWS = 256
"""Sets of numbers in an ensemble of what a machine may be."""


@dataclass(frozen=True, eq=False)
class Found:
    """What logs say of a machine.

    Attributes:
        experiment: what was believed, with the estimates in the place of what was fitted.
        unknowns: what was fitted.
        values: (p,) the estimates.
        covariance: (p, p) of their errors, with what was known beforehand.
        blind: what the logs cannot tell.
        noise: reading → standard deviation of its noise.
        scatter: what acts on the machine unrecorded → how far it strays.
        tests: of what is left of each sensor.
        held_out: the same of the part of the logs that was not fitted; empty: there was none.
        courses: reading → (2, windows) time in s since the beginning of all logs, and root mean square of whitened
            surprises in windows of time; those of a model that is right are 1.
        logs: names.
        duration: of all logs in s.
        passes: how many times the logs were gone through.
        settled: whether the fit came to an end.
        optima: the distinct ones that several starts came to, the best first.
        profiles: likelihoods of numbers for which they were asked for.
        seconds: wall time.
        forces: on the vehicle, of each log, where they were asked for.
        excess: what nobody recorded and is more than usual, in words.
    """

    experiment: Experiment
    unknowns: tuple[Unknown, ...]
    values: Floats
    covariance: Floats
    blind: tuple[Blind, ...]
    noise: dict[str, float]
    scatter: dict[str, Scatter]
    tests: tuple[Whiteness, ...]
    held_out: tuple[Whiteness, ...]
    courses: dict[str, Floats]
    logs: tuple[str, ...]
    duration: float
    passes: int
    settled: bool
    optima: tuple[Optimum, ...]
    seconds: float
    forces: tuple[Force, ...] = ()
    profiles: tuple[Profile, ...] = ()
    excess: tuple[str, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """What was fitted."""
        return tuple(unknown.key for unknown in self.unknowns)

    @property
    def deviations(self) -> Floats:
        """(p,) standard deviations of the estimates' errors."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Floats:
        """(p, p) of the estimates' errors."""
        return self.covariance / np.outer(self.deviations, self.deviations)

    def interval(self, key: str, share: float = 0.95) -> tuple[float, float]:
        """An interval that holds a number with a probability of `share`, as far as the model is right.

        Raises:
            ValueError: a key that was not fitted.
        """
        from scipy.special import ndtri

        index = self.keys.index(key)
        half = float(ndtri((1 + share) / 2) * self.deviations[index])
        return float(self.values[index]) - half, float(self.values[index]) + half

    def ensemble(self, name: str = "fitted", seed: int = 0) -> Ensemble:
        """The machines that the logs allow for: draws of the estimates' errors, correlations and all.

        A draw beyond a number's range lies at its end.

        Args:
            name: of the ensemble.
            seed: of the draws.
        """
        drawn = np.random.default_rng(seed).standard_normal((DRAWS, len(self.values)))
        size, ways = np.linalg.eigh(self.correlation)  # in units of the deviations all numbers are of one size
        draws = self.values + self.deviations * (drawn @ (np.sqrt(np.maximum(size, 0.0))[:, np.newaxis] * ways.T))
        distributions = {
            unknown.key: Drawn(Choice(tuple(np.clip(column, unknown.lower, unknown.upper).tolist())), together="fitted")
            for unknown, column in zip(self.unknowns, draws.T, strict=True)
        }
        logs = ", ".join(self.logs)
        description = f"machines that {logs} allow for: {DRAWS} draws of the estimates' errors, seed {seed}"
        return Ensemble(name, description, self.experiment, distributions)
