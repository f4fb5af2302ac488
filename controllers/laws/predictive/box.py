"""Box-constrained quadratic programs by the primal-dual active-set method, with a fixed number of iterations.

Hintermüller, Ito and Kunisch, "The primal-dual active set strategy as a semismooth Newton method" (SIAM J. Optim. 13,
2002, 865). Each iteration

1. sets the unknowns of the active set to their bounds and solves the linear system of the others;
2. adds unknowns outside the box to the active set, and removes those with a multiplier of the wrong sign.

An active set that no longer changes is the exact solution. The last sample's active set is a good initial guess.
"""

from collections.abc import Sequence

from dualwinch.model.matrix import Matrix, dot, factorised, solved
from dualwinch.model.scalar import Scalar


def least_in_box(
    quadratic: Matrix,
    linear: Sequence[Scalar],
    lower: Sequence[Scalar],
    upper: Sequence[Scalar],
    sides: Sequence[Scalar],
    iterations: int,
) -> tuple[list[Scalar], list[Scalar]]:
    """Minimise ``y' quadratic y / 2 + linear' y`` for ``lower <= y <= upper``.

    Args:
        quadratic: (n, n), symmetric and positive definite.
        linear: (n,).
        lower: (n,), not above `upper`.
        upper: (n,).
        sides: (n,) initial active set: -1 or 1 where an unknown is at its lower or upper bound, else 0.
        iterations: number of linear systems to solve.

    Returns:
        The unknowns, within the box if the active set has converged, and the new active set.
    """
    n, values = range(len(linear)), list(linear)
    for _ in range(iterations):
        low, high = [side < -0.5 for side in sides], [side > 0.5 for side in sides]
        free = [1 - low[i] - high[i] for i in n]
        at_bound = [low[i] * lower[i] + high[i] * upper[i] for i in n]
        slope = [linear[i] + dot(quadratic[i], at_bound) for i in n]
        step = _solved_where_free(quadratic, [-free[i] * slope[i] for i in n], free)
        values = [at_bound[i] + step[i] for i in n]
        push = [-(slope[i] + dot(quadratic[i], step)) for i in n]
        violation = [1.0 * (values[i] > upper[i]) - 1.0 * (values[i] < lower[i]) for i in n]
        sides = [free[i] * violation[i] + high[i] * (push[i] > 0) - low[i] * (push[i] < 0) for i in n]
    return values, list(sides)


def _solved_where_free(a: Matrix, b: Sequence[Scalar], free: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Solution for the free rows and columns; zero elsewhere, where b must be zero."""
    rows = tuple((*(free[i] * free[j] * a[i][j] for j in range(i)), a[i][i]) for i in range(len(b)))
    return solved(factorised(rows, least=None), b)
