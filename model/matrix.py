"""Small matrices of scalars, as tuples of rows, for laws whose gains solve a matrix equation."""

from collections.abc import Sequence
from typing import TypeAlias

import casadi as ca

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.scalar import Scalar, maximum

Matrix: TypeAlias = tuple[tuple[Scalar, ...], ...]
"""Rows of scalars."""


def transpose(a: Matrix) -> Matrix:
    """Transpose."""
    return tuple(zip(*a, strict=True))


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """Sum of products."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def plus(a: Matrix, b: Matrix) -> Matrix:
    """Sum of two matrices."""
    return tuple(tuple(x + y for x, y in zip(*rows, strict=True)) for rows in zip(a, b, strict=True))


def times(*factors: Matrix) -> Matrix:
    """Product of matrices, from the left."""
    product, *factors_right = factors
    for factor in factors_right:
        columns = transpose(factor)
        product = tuple(tuple(dot(row, column) for column in columns) for row in product)
    return product


def diagonal(*values: Scalar) -> Matrix:
    """Square matrix with these values on its diagonal."""
    return tuple(
        tuple(value if row == column else 0.0 for column in range(len(values))) for row, value in enumerate(values)
    )


def solve(a: Matrix, b: Matrix) -> Matrix:
    """Solution of ``a x = b`` by Gauss–Jordan elimination without pivoting: no leading minor of `a` may be zero."""
    rows = [[*coefficients, *right] for coefficients, right in zip(a, b, strict=True)]
    n = len(rows)
    for k in range(n):
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(n):
            if i != k:
                factor = rows[i][k]
                rows[i] = [value - factor * pivot for value, pivot in zip(rows[i], rows[k], strict=True)]
    return tuple(tuple(row[n:]) for row in rows)


def factorised(a: Matrix, least: float | None = 1.0) -> tuple[Matrix, tuple[Scalar, ...]]:
    """Factors of ``a = L D Lᵀ``, for a symmetric, positive definite matrix with no pivot below `least`.

    Where ``a - 1`` is positive semidefinite, that is 1. Round-off could produce a lower pivot, above all in single
    precision with elements of very different size; it is replaced by `least`. None: any pivot is taken as it is.

    The matrix is given by the rows of its lower triangle, with or without the elements above it. Returns the rows of L
    (below its diagonal of ones), and the inverses of D's diagonal.
    """
    lower: list[list[Scalar]] = []
    inverses: list[Scalar] = []
    for i, row in enumerate(a):
        factors: list[Scalar] = []
        scaled: list[Scalar] = []
        for j in range(i):
            scaled.append(row[j] - dot(scaled, lower[j]))
            factors.append(scaled[j] * inverses[j])
        pivot = row[i] - dot(scaled, factors)
        inverses.append(1 / (pivot if least is None else maximum(pivot, least)))
        lower.append(factors)
    return tuple(map(tuple, lower)), tuple(inverses)


def solved(factors: tuple[Matrix, tuple[Scalar, ...]], b: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Solution of ``a x = b`` from the `factorised` matrix."""
    lower, inverses = factors
    x: list[Scalar] = []
    for value, row in zip(b, lower, strict=True):
        x.append(value - sum(factor * component for factor, component in zip(row, x, strict=True)))
    x = [value * inverse for value, inverse in zip(x, inverses, strict=True)]
    for i in reversed(range(len(x))):
        x[i] = x[i] - sum(lower[k][i] * x[k] for k in range(i + 1, len(x)))
    return tuple(x)


def riccati(a: Matrix, g: Matrix, h: Matrix, doublings: int) -> Matrix:
    """Solution X of ``X = h + aᵀ X (1 + g X)⁻¹ a`` by structure-preserving doubling.

    Chu, Fan, Lin and Wang, Int. J. Control 77 (2004) 767. All matrices are (n, n), g and h symmetric and positive
    semidefinite. Convergence is quadratic, so a fixed number of steps suffices and the solution is an expression: of
    regulators with ``g = B R⁻¹ Bᵀ`` and ``h = Q``, of filters with ``a = Aᵀ``, ``g = Cᵀ R⁻¹ C`` and ``h = Q``, for the
    transition matrix A over a sample. It is that of the Riccati recursion after 2^doublings samples. There is no
    pivoting: scale the states to similar magnitudes. A solution from parameters alone is computed once per run.
    """
    matrices = a, g, h
    symbolic = any(isinstance(value, ca.SX) for matrix in matrices for row in matrix for value in row)
    doubled = _doubled_symbols if symbolic else _doubled
    for _ in range(doublings):
        matrices = doubled(*matrices)
    return matrices[-1]


def _doubled(a: Matrix, g: Matrix, h: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """One step of `riccati`."""
    w = plus(diagonal(*[1.0] * len(a)), times(g, h))
    w_a, w_g = solve(w, a), solve(w, g)
    return times(a, w_a), plus(g, times(a, w_g, transpose(a))), plus(h, times(transpose(a), h, w_a))


def _doubled_symbols(*matrices: Matrix) -> list[Matrix]:
    """`_doubled` by a CasADi function, whose expansion is a hundred times as fast as single scalar operations."""
    n = len(matrices[0])
    blocks = _doubling(n).call([ca.vertcat(*(value for row in matrix for value in row)) for matrix in matrices])
    return [_rows(ca.vertsplit(result), n) for result in blocks]


@built_once
def _doubling(n: int) -> ca.Function:
    symbols = [ca.SX.sym(name, n * n) for name in "agh"]
    results = _doubled(*(_rows(ca.vertsplit(symbol), n) for symbol in symbols))
    return ca.Function(
        "doubling", symbols, [ca.vertcat(*(value for row in matrix for value in row)) for matrix in results]
    )


def _rows(values: Sequence[Scalar], n: int) -> Matrix:
    return tuple(tuple(values[start : start + n]) for start in range(0, n * n, n))
