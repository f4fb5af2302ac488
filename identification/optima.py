"""Searches from several starts, and the distinct optima that they come to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.fit import Fit, Fitting
from dualwinch.identification.unknowns import Unknown
from dualwinch.model.errors import ConfigurationError

Floats = NDArray[np.float64]

APART = 1.0
"""Distance of two optima, over the standard deviation of the number that differs most, from which on they are two."""


@dataclass(frozen=True)
class Optimum:
    """Where one search or several came to rest.

    Attributes:
        values: (p,) of the unknowns.
        worse: twice the logarithm of how much less likely the logs are there than at the best.
        searches: how many came there.
    """

    values: tuple[float, ...]
    worse: float
    searches: int


def fits_from(fitting: Fitting, starts: int, seed: int, progress: Callable[[float], None]) -> list[Fit]:
    """What searches come to, the likeliest first.

    Args:
        fitting: of the logs.
        starts: how many searches; the first begins at what is believed.
        seed: of the other starts.
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError: the filter goes astray at what is believed.
        KeyboardInterrupt: interrupted.
    """
    found: list[Fit] = []
    for number, start in enumerate(starts_of(fitting.unknowns, starts, seed)):
        begun = number / starts

        def report(part: float, begun: float = begun) -> None:
            progress(begun + part / starts)

        try:
            found.append(fitting.run(start, report))
        except ConfigurationError:
            if number == 0:
                raise
    return sorted(found, key=lambda fit: fit.unlikely)


def starts_of(unknowns: Sequence[Unknown], count: int, seed: int) -> list[Floats]:
    """Where searches begin: at what is believed, and anywhere between half and twice of it or within what is known."""
    drawn, starts = np.random.default_rng(seed), [np.array([unknown.start for unknown in unknowns])]
    for _ in range(count - 1):
        moved = [
            drawn.normal(unknown.prior.mean, unknown.prior.deviation)
            if unknown.prior
            else unknown.start * 2 ** drawn.uniform(-1, 1)
            if unknown.start
            else drawn.uniform(-1, 1) * unknown.scale
            for unknown in unknowns
        ]
        starts.append(np.clip(moved, [each.lower for each in unknowns], [each.upper for each in unknowns]))
    return starts


def optima_of(fits: Sequence[Fit], covariance: Floats) -> tuple[Optimum, ...]:
    """The distinct optima, the best first.

    Args:
        fits: the likeliest first.
        covariance: (p, p) of the errors of the first.
    """
    deviations, distinct = np.sqrt(np.diag(covariance)), list[Optimum]()
    for fit in fits:
        for index, other in enumerate(distinct):
            if np.max(np.abs(fit.values - other.values) / deviations) <= APART:
                distinct[index] = Optimum(other.values, other.worse, other.searches + 1)
                break
        else:
            distinct.append(Optimum(tuple(fit.values.tolist()), fit.unlikely - fits[0].unlikely, 1))
    return tuple(distinct)
