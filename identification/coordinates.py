"""Coordinates that are searched in: a wave's cosine and sine parts in the place of its amplitude and angle.

An amplitude that goes through zero has an angle half a turn further on; one that stops at zero has lost its angle, and
a search that comes there stays. In parts, zero is a point like any other.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.unknowns import Prior, Unknown

Floats = NDArray[np.float64]

WAVES = {"eccentricity_angle": "eccentricity", "ripple_angle": "torque_ripple"}
"""Angle of a wave → its amplitude, as keys end."""

LEAST = 1e-4
"""Least amplitude, over its scale: at zero no angle has an effect."""


class Coordinates:
    """Unknowns, each over its scale; amplitude and angle of a wave, where both are unknown, as two parts.

    Attributes:
        waves: indices of amplitude and angle of each wave.
        known: (p,) 1 where something is known of an unknown beforehand, else 0.
        bounds: (p,) each, of the coordinates.
    """

    def __init__(self, unknowns: Sequence[Unknown], within: float = np.inf, itself: int | None = None) -> None:
        """Coordinates of p unknowns.

        Args:
            unknowns: p.
            within: standard deviations from what is known of an unknown beforehand that it does not leave.
            itself: an unknown that is a coordinate itself, whatever it is.
        """
        self._unknowns = tuple(unknowns)
        self._scale = np.array([unknown.scale for unknown in unknowns])
        self.waves = tuple(wave for wave in _waves(unknowns) if itself not in wave)
        self.known = np.array([each.prior is not None for each in unknowns], float)
        lower, upper = (np.array([getattr(each, end) for each in unknowns]) / self._scale for end in ("lower", "upper"))
        start = np.array([each.start for each in unknowns]) / self._scale
        likely = np.where(self.known, within, np.inf)
        lower, upper = np.maximum(lower, start - likely), np.minimum(upper, start + likely)
        for amplitude, angle in self.waves:
            lower[[amplitude, angle]], upper[[amplitude, angle]] = -upper[amplitude], upper[amplitude]
        self.bounds = lower, upper

    def of(self, values: Floats) -> Floats:
        """(p,) coordinates of values, within bounds."""
        found = values / self._scale
        for amplitude, angle in self.waves:
            size, at = values[amplitude] / self._scale[amplitude], values[angle]
            found[amplitude], found[angle] = size * np.cos(at), size * np.sin(at)
        return np.clip(found, *self.bounds)

    def values(self, coordinates: Floats) -> Floats:
        """(p,) values; angles within half a turn of zero."""
        found = coordinates * self._scale
        for amplitude, angle in self.waves:
            cosine, sine = coordinates[amplitude], coordinates[angle]
            size = np.clip(np.hypot(cosine, sine), LEAST, self.bounds[1][amplitude])
            found[amplitude], found[angle] = size * self._scale[amplitude], np.arctan2(sine, cosine)
        return found

    def slopes(self, coordinates: Floats) -> Floats:
        """(p, p) derivatives of values by coordinates."""
        found = np.diag(self._scale)
        for amplitude, angle in self.waves:
            at = np.arctan2(coordinates[angle], coordinates[amplitude])
            size = max(float(np.hypot(coordinates[amplitude], coordinates[angle])), LEAST)
            both = np.ix_([amplitude, angle], [amplitude, angle])
            by = self._scale[amplitude]
            found[both] = [[by * np.cos(at), by * np.sin(at)], [-np.sin(at) / size, np.cos(at) / size]]
        return found

    def beforehand(self) -> tuple[Floats, Floats]:
        """What is known of the unknowns: (m, p) rows, and a centre, (p,).

        The rows make standard normal numbers of coordinates less the centre. A wave whose amplitude and angle are both
        known somehow is taken for the normal distribution of its parts that has their mean and covariance.
        """
        p = len(self._unknowns)
        centre, rows, done = np.zeros(p), [], set[int]()
        for amplitude, angle in self.waves:
            size, at = self._unknowns[amplitude].prior, self._unknowns[angle].prior
            if size and at:
                mean, covariance = _parts(size, at)
                both, by = [amplitude, angle], self._scale[amplitude]
                centre[both] = mean / by
                row = np.zeros((2, p))
                row[:, both] = np.linalg.inv(np.linalg.cholesky(covariance / by**2))
                rows.append(row)
                done |= set(both)
        for index, unknown in enumerate(self._unknowns):
            if unknown.prior and index not in done:
                row = np.zeros((1, p))
                row[0, index] = self._scale[index] / unknown.prior.deviation
                centre[index] = unknown.prior.mean / self._scale[index]
                rows.append(row)
        return np.concatenate(rows) if rows else np.zeros((0, p)), centre


def _waves(unknowns: Sequence[Unknown]) -> tuple[tuple[int, int], ...]:
    """Indices of amplitude and angle of every wave of which both are unknown, something known of both or of neither."""
    index = {unknown.key: number for number, unknown in enumerate(unknowns)}
    found = []
    for key, number in index.items():
        for angle, amplitude in WAVES.items():
            other = index.get(key.removesuffix(angle) + amplitude)
            if not key.endswith(f".{angle}") or other is None:
                continue
            if bool(unknowns[other].prior) == bool(unknowns[number].prior):
                found.append((other, number))
    return tuple(found)


def _parts(size: Prior, at: Prior) -> tuple[Floats, Floats]:
    """Mean and covariance of the parts of a wave whose amplitude and angle are normal."""
    once, twice, square = np.exp(-(at.deviation**2) / 2), np.exp(-2 * at.deviation**2), size.mean**2 + size.deviation**2
    mean = size.mean * once * np.array([np.cos(at.mean), np.sin(at.mean)])
    cosine, sine = twice * np.cos(2 * at.mean), twice * np.sin(2 * at.mean)
    squares = square / 2 * np.array([[1 + cosine, sine], [sine, 1 - cosine]])
    return mean, squares - np.outer(mean, mean)
