"""Discrete algebraic Riccati equations of weights and noise levels that are symbols."""

from dualwinch.model.matrix import Matrix, diagonal, plus, solve, times, transpose


def riccati(a: Matrix, g: Matrix, h: Matrix, doublings: int) -> Matrix:
    """Solution X of ``X = h + aᵀ X (1 + g X)⁻¹ a`` by structure-preserving doubling.

    Chu, Fan, Lin and Wang, Int. J. Control 77 (2004) 767. Each step squares what is left of the start, so that a fixed
    number of steps will do and the solution is an expression: of regulators with ``g = B R⁻¹ Bᵀ`` and ``h = Q``, of
    filters with ``a = Aᵀ``, ``g = Cᵀ R⁻¹ C`` and ``h = Q``. Nothing is pivoted: states are best in units in which their
    numbers are of one size, and what follows from parameters alone is computed once a run.

    Args:
        a: motion over a sample (n, n).
        g: what is gained by acting, or by measuring; symmetric and positive semidefinite (n, n).
        h: what is lost in a sample; likewise.
        doublings: steps; the solution is that of the Riccati recursion after 2^doublings samples.
    """
    identity = diagonal(*[1.0] * len(a))
    for _ in range(doublings):
        w = plus(identity, times(g, h))
        w_a, w_g = solve(w, a), solve(w, g)
        a, g, h = (
            times(a, w_a),
            plus(g, times(a, w_g, transpose(a))),
            plus(h, times(transpose(a), h, w_a)),
        )
    return h
