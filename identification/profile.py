"""How likely a log is where a number is held and all others are fitted anew: its profile likelihood.

Where it is a parabola, the standard deviation says all; where it is not, its own interval counts (Raue et al.,
Bioinformatics 25 (2009) 1923).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.coordinates import Coordinates
from dualwinch.identification.fit import Fit, Fitting, covariance_of
from dualwinch.identification.likelihood import Likelihood

Floats = NDArray[np.float64]

REACH, POINTS = 3.0, 4
"""How far from the best a profile goes, over the standard deviation, and in how many points on each side."""

STEPS, STILL = 8, 0.02
"""Steps to where logs are likeliest at each point, at most, and the gain that counts as none."""

BOUND = 3.841458820694124
"""Rise of the sum of squares at the ends of an interval of 95 %: chi-squared of one degree of freedom."""


@dataclass(frozen=True, eq=False)
class Profile:
    """A profile.

    Attributes:
        key: of the number.
        values: (n,) at which it was held, ascending.
        rise: (n,) of minus twice the logarithm of the likelihood over the best.
    """

    key: str
    values: Floats
    rise: Floats

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 %; infinite where the profile does not rise so far."""
        best = int(np.argmin(self.rise))
        ends = []
        for side in (slice(best, None, -1), slice(best, None)):
            values, root = self.values[side], np.sqrt(np.maximum(self.rise[side], 0.0))
            beyond = np.flatnonzero(root >= np.sqrt(BOUND))
            if not len(beyond) or beyond[0] == 0:
                ends.append(np.inf * (1 if ends else -1))
                continue
            two = slice(beyond[0] - 1, beyond[0] + 1)  # the root of a parabola is a straight line
            ends.append(float(np.interp(np.sqrt(BOUND), root[two], values[two])))
        return ends[0], ends[1]


def profile_of(fitting: Fitting, fit: Fit, key: str) -> Profile:
    """The profile of a number, with noise and scatter as they are at the best.

    Args:
        fitting: of the logs.
        fit: the best.
        key: of the number.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    index = next(number for number, unknown in enumerate(fitting.unknowns) if unknown.key == key)
    covariance = covariance_of(fit.information, fitting.unknowns)
    likelihood = fitting.likelihood(Coordinates(fitting.unknowns, itself=index))
    unknown, deviation, coordinates = fitting.unknowns[index], np.sqrt(covariance[index, index]), likelihood.coordinates
    best, least = _climbed(likelihood, coordinates.of(fit.values), fit, None)
    value = float(coordinates.values(best)[index])
    found, along = {value: 0.0}, covariance[:, index] / covariance[index, index]
    for way in (-1, 1):
        at, last = best, value
        for number in range(1, POINTS + 1):
            held = float(np.clip(value + way * REACH * deviation * number / POINTS, unknown.lower, unknown.upper))
            if held in found:
                break
            start = coordinates.of(coordinates.values(at) + along * (held - last))
            at, unlikely = _climbed(likelihood, start, fit, index)
            found[held], last = unlikely - least, held
    return Profile(key, np.array(sorted(found)), np.array([found[each] for each in sorted(found)]))


def _climbed(likelihood: Likelihood, at: Floats, fit: Fit, held: int | None) -> tuple[Floats, float]:
    """Coordinates at which logs are likeliest, and how unlikely they are there; one coordinate may be held."""
    step = None
    for _ in range(STEPS):
        found = likelihood.step(at, fit.levels, step, held)
        if found is None:
            return at, np.inf
        step, at = found, found.at
        if step.better < STILL:
            break
    return at, np.inf if step is None else step.unlikely
