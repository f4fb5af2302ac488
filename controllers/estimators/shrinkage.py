"""What samples have taught, as far as it is more than their noise.

Least squares puts some of the noise into every constant, also where there is nothing to learn. Of n constants, with the
estimates w and the samples' information S, James and Stein (Estimation with quadratic loss, 1961) believe a share,

    w <- (1 - (n - 2)/chi²) w,   chi² = w'S w,

and nothing where that is negative (Baranchik, Multiple regression and estimation of the mean of a multivariate normal
distribution, 1964). From three constants on the mean square error is smaller then, whatever the constants are: much
smaller near 0, and the same where they are many deviations off.
"""

from collections.abc import Sequence

from dualwinch.controllers.estimators.least_squares import Knowledge, element
from dualwinch.model.matrix import dot, factorised, solved
from dualwinch.model.scalar import Scalar, maximum


def shrunk(known: Knowledge, n: int, exempt: Sequence[int]) -> tuple[Scalar, ...]:
    """The n estimates, all of them but the exempt ones shrunk towards 0.

    These become what the samples say of them if the others are what is believed now: some of what was put down to
    the others may be theirs. The chi² of the others counts what no values of the exempt ones explain. Exempt are
    constants that may well be far from 0, by their indices, at most n - 3.
    """
    others = [i for i in range(n) if i not in exempt]
    w = [known.estimate[i] for i in range(n)]
    shared = [sum(element(known, i, j) * w[j] for j in others) for i in exempt]
    own = [[element(known, i, j) + (1.0 if i == j else 0.0) for j in exempt[: k + 1]] for k, i in enumerate(exempt)]
    alias = solved(factorised(tuple(map(tuple, own))), shared)
    chi2 = -dot(shared, alias)
    for k, i in enumerate(others):
        before = sum(element(known, i, j) * w[j] for j in others[:k])
        chi2 += w[i] * (element(known, i, i) * w[i] + 2 * before)
    threshold = len(others) - 2
    share = 1 - threshold / maximum(chi2, threshold)
    believed = [share * value for value in w]
    for i, theirs in zip(exempt, alias, strict=True):
        believed[i] = w[i] + (1 - share) * theirs
    return tuple(believed)
