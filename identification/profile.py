"""How likely a log is where a number is held and all others are fitted anew: its profile likelihood.

Where it is a parabola, the standard deviation says all; where it is not, its own interval counts (Raue et al.,
Bioinformatics 25 (2009) 1923).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.fit import Fit, Fitting, covariance_of
from dualwinch.identification.unknowns import Prior

Floats = NDArray[np.float64]

REACH, POINTS = 3.0, 4
"""How far from the best a profile goes, over the standard deviation, and in how many points on each side."""

PINNED = 1e-3
"""Standard deviation of a number that is held, over that of its estimate."""

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
    """The profile of a number, with noise, scatter and gains as they are at the best.

    Args:
        fitting: of the logs.
        fit: the best.
        key: of the number.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    index = next(number for number, unknown in enumerate(fitting.unknowns) if unknown.key == key)
    unknown, covariance = fitting.unknowns[index], covariance_of(fit.information, fitting.unknowns)
    deviation = float(np.sqrt(covariance[index, index]))
    best, _, least = fitting.solved(fit.values, fit.levels, fit.weights)
    found = {float(best[index]): 0.0}
    for way in (-1, 1):
        values = best
        for number in range(1, POINTS + 1):
            held = float(np.clip(best[index] + way * REACH * deviation * number / POINTS, unknown.lower, unknown.upper))
            if held in found:
                break
            start = values + covariance[:, index] / covariance[index, index] * (held - values[index])
            pin = Prior(held, PINNED * deviation)
            values, _, squares = fitting.solved(start, fit.levels, fit.weights, [(index, pin)])
            found[held] = squares - least
    return Profile(key, np.array(sorted(found)), np.array([found[value] for value in sorted(found)]))
