"""Recursive least squares with a prior that is never forgotten.

Unknown are constants w, in units of the standard deviations that are believed of them before the first sample. A
sample is a row of regressors h and what was measured, y = h'w + noise of unit variance, and the older it is, the less
it counts. The estimate is where

    |w|² + sum over the samples of fade^age weight (y - h'w)²

is smallest (Ljung and Söderström, Theory and Practice of Recursive Identification, 1983, Section 2.6; the first term
is Tikhonov's). Only the samples' information is forgotten: what they no longer tell returns to the prior, so that a
machine that stands still for an hour neither winds up nor remembers more than it sees.

With the samples' information S and the estimate w of the last sample, forgetting turns these to

    S <- fade S,   w <- w - (1 - fade) (1 + fade S)⁻¹ w

and a sample of some weight to

    S <- S + weight h h',   w <- w + weight q (y - h'w) / (1 + weight h'q),   q = (1 + fade S)⁻¹ h.

The state is the estimate itself, not the vector S w: then round-off, that of single precision too, is corrected by the
samples that follow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from dualwinch.model.matrix import Matrix, dot, factorised, solved
from dualwinch.model.quantities.quantity import Mark, Quantity, vector
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Knowledge:
    """What is known of n constants, over the deviations believed before."""

    estimate: Annotated[Any, Quantity("1", "estimates over the deviations believed before"), Mark.LEARNT]
    information: Annotated[Any, Quantity("1", "information of the samples, lower triangle by rows"), Mark.LEARNT]


def ignorance(n: int) -> Knowledge:
    """What is known of n constants before the first sample."""
    return Knowledge(np.zeros(n), np.zeros(n * (n + 1) // 2))


@dataclass(frozen=True)
class Expectation:
    """What is expected of a sample.

    Attributes:
        estimate: the constants, what is forgotten by now left out.
        value: of what is measured.
        gain: of the estimate on a sample, before its weight: q above.
        variance: of the value, over that of a sample's noise.
    """

    estimate: tuple[Scalar, ...]
    value: Scalar
    gain: tuple[Scalar, ...]
    variance: Scalar


def expected(known: Knowledge, regressors: Sequence[Scalar], fade: Scalar) -> Expectation:
    """What is expected of the next sample, by its (n,) regressors.

    Of the information of the samples before, the share `fade` is left.
    """
    n = len(regressors)
    estimate = [known.estimate[i] for i in range(n)]
    factors = factorised(_with_prior(known, n, fade))
    lost = solved(factors, estimate)
    estimate = tuple(value - (1 - fade) * loss for value, loss in zip(estimate, lost, strict=True))
    gain = solved(factors, regressors)
    return Expectation(estimate, dot(regressors, estimate), gain, dot(regressors, gain))


def learnt(
    known: Knowledge,
    regressors: Sequence[Scalar],
    expectation: Expectation,
    innovation: Scalar,
    weight: Scalar,
    fade: Scalar,
) -> Knowledge:
    """What is known after a sample with (n,) regressors, of which the expectation was made with the same `fade`.

    The innovation is over the deviation of the sample's noise; `weight` is 1 for a sample of that noise, 0 for none.
    """
    step = weight * innovation / (1 + weight * expectation.variance)
    estimate = [value + gain * step for value, gain in zip(expectation.estimate, expectation.gain, strict=True)]
    information = [
        fade * known.information[_index(i, j)] + weight * regressors[i] * regressors[j]
        for i in range(len(regressors))
        for j in range(i + 1)
    ]
    return Knowledge(vector(estimate), vector(information))


def variances(known: Knowledge, n: int) -> tuple[Scalar, ...]:
    """Variances of the n estimates, over those believed before: 1 is to know nothing new."""
    factors = factorised(_with_prior(known, n, 1.0))
    units = [[1.0 if row == column else 0.0 for row in range(n)] for column in range(n)]
    return tuple(solved(factors, unit)[index] for index, unit in enumerate(units))


def element(known: Knowledge, row: int, column: int) -> Scalar:
    """Element of the samples' information, a symmetric matrix."""
    return known.information[_index(max(row, column), min(row, column))]


def _with_prior(known: Knowledge, n: int, fade: Scalar) -> Matrix:
    return tuple(
        tuple(fade * known.information[_index(i, j)] + (1.0 if i == j else 0.0) for j in range(i + 1)) for i in range(n)
    )


def _index(row: int, column: int) -> int:
    """Where an element of the lower triangle stands."""
    return row * (row + 1) // 2 + column
