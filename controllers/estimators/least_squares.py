"""Recursive least squares with exponential forgetting of the samples, but not of the prior.

The unknowns are constants w, in units of their prior standard deviations. A sample consists of regressors h and a
measurement y = h'w + noise of unit variance. The estimate minimises

    |w|² + sum over the samples of fade^age weight (y - h'w)²

(Ljung and Söderström, Theory and Practice of Recursive Identification, 1983, Section 2.6; the first term is
Tikhonov's). Only the samples' information is forgotten: without new information the estimate returns to the prior, so
that it does not wind up while the machine stands still.

With the samples' information S and the estimate w of the last sample, forgetting is

    S <- fade S,   w <- w - (1 - fade) (1 + fade S)⁻¹ w

and the update by a sample

    S <- S + weight h h',   w <- w + weight q (y - h'w) / (1 + weight h'q),   q = (1 + fade S)⁻¹ h.

The state is the estimate itself, not the vector S w: later samples then correct round-off, even in single precision.
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
    """Estimates of n constants over their prior deviations, and the information of the samples."""

    estimate: Annotated[Any, Quantity("1", "estimates over their prior deviations"), Mark.LEARNT]
    information: Annotated[Any, Quantity("1", "information of the samples, lower triangle by rows"), Mark.LEARNT]


def ignorance(n: int) -> Knowledge:
    """The prior of n constants: zero estimates without information."""
    return Knowledge(np.zeros(n), np.zeros(n * (n + 1) // 2))


@dataclass(frozen=True)
class Expectation:
    """Prediction of a sample.

    Attributes:
        estimate: the constants after forgetting.
        value: predicted measurement.
        gain: gain of the estimate on a sample, without its weight: q above.
        variance: variance of the value over that of a sample's noise.
    """

    estimate: tuple[Scalar, ...]
    value: Scalar
    gain: tuple[Scalar, ...]
    variance: Scalar


def expected(known: Knowledge, regressors: Sequence[Scalar], fade: Scalar) -> Expectation:
    """Prediction of the next sample from its (n,) regressors; the information of earlier samples fades by `fade`."""
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
    """The estimates updated by samples with the same (n,) regressors and expectation, both with the same `fade`.

    The innovation is the weighted sum of theirs, relative to the deviation of a sample's noise; `weight` is the sum of
    their weights: 1 for one sample, 0 for none.
    """
    step = innovation / (1 + weight * expectation.variance)
    estimate = [value + gain * step for value, gain in zip(expectation.estimate, expectation.gain, strict=True)]
    information = [
        fade * known.information[_index(i, j)] + weight * regressors[i] * regressors[j]
        for i in range(len(regressors))
        for j in range(i + 1)
    ]
    return Knowledge(vector(estimate), vector(information))


def variances(known: Knowledge, n: int) -> tuple[Scalar, ...]:
    """Variances of the n estimates over those of the prior: 1 without information."""
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
    """Index of an element of the lower triangle, stored by rows."""
    return row * (row + 1) // 2 + column
