"""What logs cannot tell: directions in which numbers may change together and nothing that was read would show it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.unknowns import Unknown

Floats = NDArray[np.float64]

BLIND = 0.5
"""Standard deviation of a direction, over what is believed beforehand, from which on logs do not tell it."""

TAKES_PART = 0.3
"""Share of the largest in a direction from which on a number takes part in it."""


@dataclass(frozen=True)
class Blind:
    """A direction that logs do not tell.

    Attributes:
        keys: the numbers that take part, the most first.
        deviation: of the direction by the logs alone, over the numbers' scales; infinite: nothing at all.
    """

    keys: tuple[str, ...]
    deviation: float

    @property
    def words(self) -> str:
        """What cannot be told, in a sentence."""
        first, *others = self.keys
        if not others:
            return f"{first}: these logs say next to nothing of it"
        return f"{first}: only together with {' and '.join(others)}"


def believed(unknowns: Sequence[Unknown]) -> Floats:
    """What is a large change of each number: the deviation of what is known of it, else its scale."""
    return np.array([unknown.prior.deviation if unknown.prior else unknown.scale for unknown in unknowns])


def blind(information: Floats, unknowns: Sequence[Unknown]) -> tuple[Blind, ...]:
    """The directions that logs do not tell, the blindest first.

    Args:
        information: (p, p) of the logs alone.
        unknowns: p.
    """
    by = believed(unknowns)
    size, ways = np.linalg.eigh(information * np.outer(by, by))
    found = []
    for told, way in zip(size, ways.T, strict=True):
        if told * BLIND**2 >= 1:
            continue
        order = np.argsort(-np.abs(way))
        taking = [int(index) for index in order if abs(way[index]) >= TAKES_PART * abs(way[order[0]])]
        deviation = float(1 / np.sqrt(told)) if told > 0 else np.inf
        found.append(Blind(tuple(unknowns[index].key for index in taking), deviation))
    return tuple(found)
