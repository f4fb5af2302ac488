"""Transmission zeros and DC gains of a linear system."""

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.linear.controllability import balanced
from dualwinch.model.linear.system import LinearSystem

Array = NDArray[np.float64]
Matrices: TypeAlias = tuple[Array, Array, Array, Array]

RANK = 1e-11
"""Singular values below this are zero, of rows that are of unit length."""

STILL = 1e-10
"""Poles nearer to 0 (discrete: to 1) than this share of the norm of A are integrators."""

SILENT = 1e-9
"""An integrator that adds less than this to an output does not reach it; both ends in balanced units."""


def zeros(system: LinearSystem) -> NDArray[np.complex128]:
    """Finite invariant zeros: rates at which the system can be driven without any answer of its outputs.

    Zeros at infinity are taken away by orthogonal reductions before eigenvalues are computed (Emami-Naeini and Van
    Dooren, Automatica 18, 1982), so that none of them turns up as a large number. Inputs and outputs may differ in
    number; modes that no input moves or no output shows are among the zeros.

    Returns:
        In 1/s; of a discrete system in the z plane.
    """
    part = balanced(system)
    A, B, C, D = _transposed(_reduced(_transposed(_reduced((part.A, part.B, part.C, part.D)))))
    return np.linalg.eigvals(A - B @ np.linalg.solve(D, C)).astype(np.complex128)


def _transposed(matrices: Matrices) -> Matrices:
    A, B, C, D = matrices
    return A.T, C.T, B.T, D.T


def _reduced(matrices: Matrices) -> Matrices:
    """A system with the same finite zeros whose D has full row rank."""
    A, B, C, D = matrices
    while True:
        lengths = np.linalg.norm(np.hstack([C, D]), axis=1, keepdims=True)
        C, D = (np.where(lengths > RANK, matrix / np.maximum(lengths, RANK), 0.0) for matrix in (C, D))
        U, sizes, _ = np.linalg.svd(D)
        fed = int(np.sum(sizes > RANK))
        C, D = U.T @ C, U.T @ D
        C_fed, D_fed, C_left = C[:fed], D[:fed], C[fed:]
        _, sizes, V = np.linalg.svd(C_left)
        seen = int(np.sum(sizes > RANK))
        if not seen:
            return A, B, C_fed, D_fed
        # silent outputs hold the states they see at zero; what keeps them there becomes the new outputs
        held, free = V[:seen].T, V[seen:].T
        C, D = np.vstack([held.T @ A @ free, C_fed @ free]), np.vstack([held.T @ B, D_fed])
        A, B = free.T @ A @ free, free.T @ B


def dc_gains(system: LinearSystem) -> Array:
    """Change of every output for a lasting unit change of every input, once all has settled.

    Returns:
        Array of shape (outputs, inputs), in output units per input unit; infinite where an integrator lies between.
        It says nothing about stability: unstable modes are taken to be held by a controller.
    """
    from scipy.linalg import schur, solve_sylvester

    part = balanced(system)
    A = part.A if system.dt is None else part.A - np.eye(len(part.A))
    near = STILL * float(np.linalg.norm(A, 2))
    ordered: Any = schur(A, output="complex", sort=lambda pole: abs(pole) < near)
    T, Z, integrators = ordered
    k = int(integrators)
    coupling = solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if 0 < k < len(T) else np.zeros((k, len(T) - k))
    B, C = Z.conj().T @ part.B, part.C @ Z
    chain, C_moving = B[:k] - coupling @ B[k:], C[:, :k] @ coupling + C[:, k:]
    gains = part.D - (C_moving @ np.linalg.solve(T[k:, k:], B[k:])).real
    gains = np.where(np.abs(gains) > SILENT * np.abs(gains).max(axis=1, keepdims=True), gains, 0.0)
    for _ in range(k):
        reached = (C[:, :k] @ chain).real
        gains = np.where(np.abs(reached) > SILENT, np.copysign(math.inf, reached), gains)
        chain = T[:k, :k] @ chain
    return gains * part.outputs[:, None] / part.inputs
