"""Shrinkage of least-squares estimates towards zero by the noise of the samples.

Least squares fits noise by every constant, even if all of them are zero. The estimator of James and Stein (Estimation
with quadratic loss, 1961) shrinks the estimates w of n constants with the samples' information S,

    w <- (1 - (n - 2)/chi²) w,   chi² = w'S w,

and to zero where the factor is negative (Baranchik, Multiple regression and estimation of the mean of a multivariate
normal distribution, 1964). For three constants or more this has a smaller mean square error, for any true values: much
smaller near 0, and the same at many deviations.
"""

from collections.abc import Sequence

from dualwinch.controllers.estimators.least_squares import Knowledge, element
from dualwinch.model.matrix import dot, factorised, solved
from dualwinch.model.scalar import Scalar, maximum


def shrunk(known: Knowledge, n: int, exempt: Sequence[int]) -> tuple[Scalar, ...]:
    """The n estimates shrunk towards 0, except those with indices in `exempt`.

    The exempt ones, at most n - 3 constants that may be far from 0, become their least-squares estimates given the
    shrunk others. The chi² of the others is that of the part which no values of the exempt ones explain.
    """
    shrinking = [i for i in range(n) if i not in exempt]
    w = [known.estimate[i] for i in range(n)]
    shared = [sum(element(known, i, j) * w[j] for j in shrinking) for i in exempt]
    exempt_block = [
        [element(known, i, j) + (1.0 if i == j else 0.0) for j in exempt[: k + 1]] for k, i in enumerate(exempt)
    ]
    alias = solved(factorised(tuple(map(tuple, exempt_block))), shared)
    chi2 = -dot(shared, alias)
    for k, i in enumerate(shrinking):
        before = sum(element(known, i, j) * w[j] for j in shrinking[:k])
        chi2 += w[i] * (element(known, i, i) * w[i] + 2 * before)
    threshold = len(shrinking) - 2
    share = 1 - threshold / maximum(chi2, threshold)
    estimates = [share * value for value in w]
    for i, theirs in zip(exempt, alias, strict=True):
        estimates[i] = w[i] + (1 - share) * theirs
    return tuple(estimates)
