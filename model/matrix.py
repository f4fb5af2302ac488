"""Small matrices of scalars, as tuples of rows: for laws whose gains are the solution of a matrix equation."""

from typing import TypeAlias

from dualwinch.model.scalar import Scalar

Matrix: TypeAlias = tuple[tuple[Scalar, ...], ...]
"""Rows of scalars."""


def transpose(a: Matrix) -> Matrix:
    """Transpose."""
    return tuple(zip(*a, strict=True))


def plus(a: Matrix, b: Matrix) -> Matrix:
    """Sum of two matrices."""
    return tuple(tuple(x + y for x, y in zip(*rows, strict=True)) for rows in zip(a, b, strict=True))


def times(*factors: Matrix) -> Matrix:
    """Product of matrices, from the left."""
    product, *others = factors
    for factor in others:
        columns = transpose(factor)
        product = tuple(
            tuple(sum(x * y for x, y in zip(row, column, strict=True)) for column in columns) for row in product
        )
    return product


def diagonal(*values: Scalar) -> Matrix:
    """Square matrix with these values on its diagonal."""
    return tuple(
        tuple(value if row == column else 0.0 for column in range(len(values))) for row, value in enumerate(values)
    )


def solve(a: Matrix, b: Matrix) -> Matrix:
    """Solution of ``a x = b`` by elimination without pivoting: no leading minor of `a` may be zero."""
    rows = [[*left, *right] for left, right in zip(a, b, strict=True)]
    n = len(rows)
    for k in range(n):
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(n):
            if i != k:
                factor = rows[i][k]
                rows[i] = [value - factor * pivot for value, pivot in zip(rows[i], rows[k], strict=True)]
    return tuple(tuple(row[n:]) for row in rows)
