"""Stability, controllability, observability and DC gains of a linear system.

Controllability and observability are tested mode by mode (Popov, Belevitch and Hautus). All measures are taken in
balanced states (diagonal scaling), with inputs and outputs scaled to unit size, so that the choice of units does not
matter. They assume perfect sensors and unlimited inputs: a small but positive number requires a sensor better by its
inverse.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.linear.system import LinearSystem

Array = NDArray[np.float64]

BALANCING_ROUNDS = 6
"""Rounds of balancing many matrices: scales of physical units are found within three or four."""

BACKWARD_ERROR = 10
"""Relative error of a matrix in units of n eps, with its size n."""

RANK = 1e-11
"""Singular values below this count as zero, for matrices or rows of unit size: round-off."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """Matrices in balanced states.

    Attributes:
        A, B, C, D: matrices; the columns of B and the rows of C have unit length (or are zero).
        inputs, outputs: size of one balanced unit in units of the system's input (output).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: Array
    outputs: Array


def balanced(system: LinearSystem) -> Balanced:
    """A system in states scaled by powers of two, so that rows and columns of A have similar norms."""
    from scipy.linalg import matrix_balance

    A, (scale, _) = matrix_balance(system.A, permute=False, separate=True)
    B, C = system.B / scale[:, None], system.C * scale
    inputs, outputs = 1 / _lengths(B.T), _lengths(C)
    return Balanced(A, B * inputs, C / outputs[:, None], system.D * inputs / outputs[:, None], inputs, outputs)


def _lengths(rows: Array) -> Array:
    lengths = np.linalg.norm(rows, axis=1)
    return np.where(lengths > 0, lengths, 1.0)


def balancing_scales(A: Array) -> Array:
    """Scales of states (s, n), powers of two, that balance rows and columns of matrices A (s, n, n).

    By Parlett and Reinsch, Numer. Math. 13, 1969: ``A / scale[:, None] * scale`` is balanced.
    """
    scale = np.ones(A.shape[:2])
    off = np.abs(A) * (1 - np.eye(A.shape[1]))
    for _ in range(BALANCING_ROUNDS):
        scaled = off / scale[:, :, None] * scale[:, None, :]
        rows, columns = scaled.sum(axis=2), scaled.sum(axis=1)
        both = (rows > 0) & (columns > 0)
        ratio = np.sqrt(np.where(both, rows, 1.0) / np.where(both, columns, 1.0))
        scale *= 2.0 ** np.round(np.log2(ratio))
    return scale


def eigenvalue_errors(A: Array, right: NDArray[np.complex128], left: NDArray[np.complex128]) -> Array:
    """Bounds on the rounding errors of the eigenvalues (s, n) of matrices A (s, n, n).

    The first-order bound of a backward stable method, ``p(n) eps ‖A‖ ‖x‖ ‖y‖/|y* x|``, with right eigenvectors x
    (columns), left ones y* (rows) and the Frobenius norm, all in balanced states (Anderson et al., *LAPACK Users'
    Guide*, 1999, Section 4.8). p(n) is `BACKWARD_ERROR` n, as the elements of A are rounded results too. Rounding
    splits a double eigenvalue into two whose distance is about |y* x|, and the bound then has that size.
    """
    scale = balancing_scales(A)
    size = np.linalg.norm(A / scale[:, :, None] * scale[:, None], axis=(1, 2))
    columns = np.linalg.norm(right / scale[:, :, None], axis=1)
    rows = np.linalg.norm(left * scale[:, None], axis=2)
    cosines = np.abs(np.einsum("sij,sji->si", left, right)) / np.maximum(columns * rows, np.finfo(float).tiny)
    rounding = BACKWARD_ERROR * A.shape[1] * np.finfo(float).eps * size[:, None]
    return rounding / np.maximum(cosines, np.finfo(float).tiny)


def has_growth(A: Array, dt: float | None) -> bool:
    """Whether a mode of ``dx/dt = A x``, or ``x[k+1] = A x[k]`` with a sample time, grows beyond rounding errors.

    A mode whose eigenvalue lies on the limit of stability within its rounding error (`eigenvalue_errors`), such as an
    integrator, does not grow.
    """
    from scipy.linalg import eig

    if not np.isfinite(A).all():
        return True
    if not (_excess(np.linalg.eigvals(A).astype(np.complex128), dt) > 0).any():
        return False
    decomposition: Any = eig(A, left=True)
    values, left_vectors, right = decomposition
    errors = eigenvalue_errors(A[None], right[None], left_vectors.conj().T[None])[0]
    return bool((_excess(values, dt) > errors).any())


def _excess(poles: NDArray[np.complex128], dt: float | None) -> Array:
    """How far poles are beyond the limit of stability."""
    return poles.real if dt is None else np.abs(poles) - 1


def is_stable(system: LinearSystem) -> bool:
    """Whether no mode of a system grows (`has_growth`)."""
    return not has_growth(system.A, system.dt)


def mode_controllability(system: LinearSystem, inputs: Sequence[str] | None = None) -> Array:
    """Distance of every eigenvalue from being uncontrollable by the inputs (default: all).

    Returns:
        Smallest singular value of ``[A - lambda I, B]`` over the norm of A, for the eigenvalues in the order of
        ``system.poles()`` (n); 0 up to round-off where no input affects the mode.

    Raises:
        ConfigurationError: an unknown input.
    """
    part = balanced(system.between(system.inputs if inputs is None else inputs, system.outputs))
    return _distances(part.A.T, part.B.T, system.poles())


def mode_observability(system: LinearSystem, outputs: Sequence[str] | None = None) -> Array:
    """Distance of every eigenvalue from being unobservable from the outputs (see `mode_controllability`).

    Raises:
        ConfigurationError: an unknown output.
    """
    part = balanced(system.between(system.inputs, system.outputs if outputs is None else outputs))
    return _distances(part.A, part.C, system.poles())


def _distances(A: Array, C: Array, eigenvalues: NDArray[np.complex128]) -> Array:
    size = np.linalg.norm(A, 2)
    pencils = (A - eigenvalues[:, None, None] * np.eye(len(A))) / size
    rows = np.broadcast_to(C, (len(eigenvalues), *C.shape))
    sizes = np.linalg.svd(np.concatenate([pencils, rows], axis=1), compute_uv=False)
    return sizes[:, -1].astype(np.float64)


def is_controllable(system: LinearSystem, inputs: Sequence[str] | None = None) -> bool:
    """Whether every mode is controllable from the inputs (default: all)."""
    return bool(np.all(mode_controllability(system, inputs) > RANK))


def is_observable(system: LinearSystem, outputs: Sequence[str] | None = None) -> bool:
    """Whether every mode is observable from the outputs (default: all)."""
    return bool(np.all(mode_observability(system, outputs) > RANK))


def sufficient_sensors(system: LinearSystem) -> tuple[tuple[str, ...], ...]:
    """The minimal sets of outputs from which every mode is observable.

    Smaller sets come first; empty where not even all outputs suffice.
    """
    minimal_sets: list[tuple[str, ...]] = []
    for size in range(1, len(system.outputs) + 1):
        for outputs in combinations(system.outputs, size):
            larger = any(set(smaller) <= set(outputs) for smaller in minimal_sets)
            if not larger and is_observable(system, outputs):
                minimal_sets.append(outputs)
    return tuple(minimal_sets)


INTEGRATOR = 1e-10
"""Poles nearer to 0 (discrete: to 1) than this share of the norm of A are integrators."""

NO_GAIN = 1e-9
"""Gain in balanced units below which an integrator does not reach an output."""


def dc_gains(system: LinearSystem) -> Array:
    """Steady-state change of every output for a unit step of every input.

    Returns:
        Array of shape (outputs, inputs), in output units per input unit; infinite where an integrator lies between.
        Stability is not required: unstable modes are assumed to be stabilised by a controller.
    """
    from scipy.linalg import schur, solve_sylvester

    part = balanced(system)
    A = part.A if system.dt is None else part.A - np.eye(len(part.A))
    near = INTEGRATOR * float(np.linalg.norm(A, 2))
    ordered: Any = schur(A, output="complex", sort=lambda pole: abs(pole) < near)
    T, Z, integrators = ordered
    k = int(integrators)
    coupling = solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if 0 < k < len(T) else np.zeros((k, len(T) - k))
    B, C = Z.conj().T @ part.B, part.C @ Z
    chain, C_moving = B[:k] - coupling @ B[k:], C[:, :k] @ coupling + C[:, k:]
    gains = part.D - (C_moving @ np.linalg.solve(T[k:, k:], B[k:])).real
    gains = np.where(np.abs(gains) > NO_GAIN * np.abs(gains).max(axis=1, keepdims=True), gains, 0.0)
    for _ in range(k):
        reached = (C[:, :k] @ chain).real
        gains = np.where(np.abs(reached) > NO_GAIN, np.copysign(math.inf, reached), gains)
        chain = T[:k, :k] @ chain
    return gains * part.outputs[:, None] / part.inputs


def states_that_matter(A: Array, B: Array, C: Array) -> NDArray[np.bool_]:
    """States of many systems that are not constant and that affect an output, directly or through other states.

    From the matrices A (s, n, n), B (s, n, m) and C (s, p, n) of discrete systems.

    Returns:
        (s, n); false for constant states, such as an integral without a gain.
    """
    depends, matters = A != 0, (C != 0).any(axis=1)
    while True:
        grown = matters | (matters[:, :, None] & depends).any(axis=1)
        if (grown == matters).all():
            break
        matters = grown
    moves = depends.any(axis=2) & (np.eye(A.shape[1]) != A).any(axis=2)
    return matters & (moves | (B != 0).any(axis=2))
