"""Complementary sensitivities T = L/(1 + L) of many loops at every cut, as sums over their poles and as they are.

Every margin is a distance of T from one half or from the real axis: the loop gain is 1 where Re T = 1/2, it is real
where T is, and the largest disk has the radius 1 / max|T - 1/2|. T of a loop closed at all cuts but for what is added
at one is stable where the loop is, so that its poles say where to look.

A computer that is late, or a supply that is weak, changes both torques alike. For such a change the eigenvalues of the
two torques' T, a matrix, are what T is at a cut (the characteristic loci of MacFarlane and Postlethwaite, Int. J.
Control 25, 1977).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]

BOTH = "torques"
"""What a change of both torques alike is called, beside the cuts."""

LOCI = ("u", "tau_1", "tau_2", BOTH, BOTH)
"""Where each of the five loci of a loop is cut."""

ROWS, COLUMNS = (0, 1, 1, 2, 2), (0, 1, 2, 1, 2)
"""Cuts at which the five elements of T that are needed come out and go in."""

FORGOTTEN, SILENT = 0.05, 1e-14
"""Magnitude of poles that are left out of sums over poles: those of delays are 0, and have too few eigenvectors. And
the share of the largest echo of these at which the next ones are left out."""

DIAGONAL = np.array([0, 1, 4, 1, 1])
"""Which of the elements a locus is; of the last two any."""


@dataclass(frozen=True, eq=False)
class Complementary:
    """T of s loops of one sample time.

    Attributes:
        A, B, C, D: closed loops, (s, n, n), (s, n, 3), (s, 3, n), (s, 3, 3): T = C (z - A)^-1 B + D. A state that does
            not matter in one of them has zeros there.
        poles: (s, n) eigenvalues of A.
        residues: (s, 5, n) of the elements of T (`ROWS`, `COLUMNS`) at the poles; 0 at those that are forgotten within
            few samples (`FORGOTTEN`).
        echoes: (j, s, 5) what those come to, j samples after an impulse.
        dt: sample time in s.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    poles: Complex
    residues: Complex
    echoes: Floats
    dt: float

    @property
    def stable(self) -> Flags:
        """(s,) whether a loop is stable."""
        return np.abs(self.poles).max(axis=1, initial=0.0) < 1

    def loci(self, omega: Floats) -> Complex:
        """The loci (s, 5, k) of all loops at ascending frequencies (s, k) in rad/s, by sums over poles."""
        z = np.exp(1j * self.dt * omega)
        elements = np.repeat(self.D[:, ROWS, COLUMNS][:, :, None].astype(complex), omega.shape[1], axis=2)
        for index in range(self.poles.shape[1]):
            if self.residues[:, :, index].any():
                elements += self.residues[:, :, index, None] / (z - self.poles[:, index, None])[:, None]
        late = 1 / z[:, None]
        for echo in self.echoes:
            elements += echo[:, :, None] * late
            late = late / z[:, None]
        alone = elements[:, DIAGONAL[:3]]
        half, root = _halves(elements)
        first, second = half + root, half - root
        kept = np.abs(np.diff(first)) + np.abs(np.diff(second))
        crossed = np.abs(first[:, 1:] - second[:, :-1]) + np.abs(second[:, 1:] - first[:, :-1])
        swapped = np.zeros(first.shape, bool)
        swapped[:, 1:] = np.logical_xor.accumulate(crossed < kept, axis=1)
        pair = np.where(swapped, second, first), np.where(swapped, first, second)
        return np.concatenate([alone, np.stack(pair, axis=1)], axis=1)

    def quick(self, omega: Floats, loop: Indices, locus: Indices, near: Complex) -> tuple[Complex, Complex]:
        """Loci (a,) and their derivatives by the frequency, at a frequency each, by sums over poles.

        Args:
            omega: angular frequencies in rad/s.
            loop: indices of the loops.
            locus: indices of the loci.
            near: about where they are, which tells the last two apart.
        """
        z = np.exp(1j * self.dt * omega)
        apart = (z[:, None] - self.poles[loop])[:, None]
        terms = self.residues[loop] / apart
        values = terms.sum(axis=2) + self.D[loop][:, ROWS, COLUMNS]
        slopes = -1j * self.dt * z[:, None] * (terms / apart).sum(axis=2)
        for number, echo in enumerate(self.echoes[:, loop], start=1):
            late = echo * z[:, None] ** -number
            values += late
            slopes -= 1j * self.dt * number * late
        return _locus(values, slopes, locus, near)

    def exact(self, omega: Floats, loop: Indices, locus: Indices, near: Complex) -> tuple[Complex, Complex]:
        """The same from the matrices, as exact as they are."""
        z = np.exp(1j * self.dt * omega)
        pencil = z[:, None, None] * np.eye(self.A.shape[1]) - self.A[loop]
        right = np.linalg.solve(pencil, self.B[loop].astype(complex))
        values = self.C[loop] @ right + self.D[loop]
        slopes = -1j * self.dt * z[:, None, None] * (self.C[loop] @ np.linalg.solve(pencil, right))
        elements, rates = (np.asarray(matrix[:, ROWS, COLUMNS], complex) for matrix in (values, slopes))
        return _locus(elements, rates, locus, near)


def _halves(elements: Complex) -> tuple[Complex, Complex]:
    """Mean and half the distance of the eigenvalues of the torques' T, of its elements along the second axis."""
    _, first, upper, lower, second = np.moveaxis(elements, 1, 0)
    return (first + second) / 2, np.sqrt(((first - second) / 2) ** 2 + upper * lower)


def _locus(values: Complex, slopes: Complex, locus: Indices, near: Complex) -> tuple[Complex, Complex]:
    """Loci and their slopes (a,) from the elements of T and theirs (a, 5)."""
    row = np.arange(len(values))
    alone = values[row, DIAGONAL[locus]], slopes[row, DIAGONAL[locus]]
    half, root = _halves(values)
    both = half + np.where(np.abs(half + root - near) <= np.abs(half - root - near), root, -root)
    _, first, upper, lower, second = values.T
    _, d_first, d_upper, d_lower, d_second = slopes.T
    turned = d_first * (both - second) + d_second * (both - first) + d_upper * lower + upper * d_lower
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = turned / (2 * (both - half))
    together = locus >= len(DIAGONAL) - 2
    return np.where(together, both, alone[0]), np.where(together, rate, alone[1])


def complementary(A: Floats, B: Floats, C: Floats, D: Floats, dt: float) -> Complementary:
    """T of loops that are open at all three cuts.

    Args:
        A: of the states, (s, n, n).
        B: by what leaves the cuts, (s, n, 3).
        C: of what comes back to them, (s, 3, n).
        D: of the one by the other, (s, 3, 3).
        dt: sample time in s.
    """
    through = np.linalg.inv(np.eye(D.shape[1]) - D)
    C, entered = through @ C, B @ through
    closed = A + B @ C
    matter = _that_matter(closed, entered, C)
    closed = np.where(matter[:, :, None] & matter[:, None, :], closed, 0.0)
    entered, C = np.where(matter[:, :, None], entered, 0.0), np.where(matter[:, None, :], C, 0.0)
    kept = np.flatnonzero(matter.any(axis=0))
    closed, entered, C = closed[:, kept][:, :, kept], entered[:, kept], C[:, :, kept]
    size = _sizes(closed)
    alike = closed / size[:, :, None] * size[:, None, :]
    B, C = entered / size[:, :, None], -C * size[:, None, :]
    poles, residues, echoes = _parts(alike, B, C)
    return Complementary(alike, B, C, -through @ D, poles, residues, echoes, dt)


def _parts(A: Floats, B: Floats, C: Floats) -> tuple[Complex, Complex, Floats]:
    """Poles, residues and echoes (`Complementary`), by right and left eigenvectors of the poles that last."""
    poles, right = _by_size(A)
    _, left = _by_size(np.swapaxes(A, 1, 2))
    lasting = np.abs(poles) > FORGOTTEN
    right, left = np.where(lasting[:, None], right, 0.0), np.where(lasting[:, None], left, 0.0)
    across = np.swapaxes(left, 1, 2) @ right
    index = np.arange(A.shape[1])
    across[:, index, index] += ~lasting
    weights = np.linalg.solve(across, np.swapaxes(left, 1, 2) @ B)
    shown = C @ right
    residues = shown[:, ROWS] * np.swapaxes(weights, 1, 2)[:, COLUMNS]
    echoes, rest = [], B - (right @ weights).real
    for _ in range(A.shape[1] + 10):
        echoes.append((C @ rest)[:, ROWS, COLUMNS])
        if not np.abs(rest).max(initial=0.0) > SILENT * np.abs(B).max(initial=0.0):
            break
        rest = A @ rest
    return poles, np.asarray(residues, complex), np.array(echoes)


def _by_size(A: Floats) -> tuple[Complex, Complex]:
    """Eigenvalues and eigenvectors of matrices, the largest eigenvalues first."""
    values, vectors = np.linalg.eig(A)
    order = np.argsort(-np.abs(values), axis=1)
    found = np.take_along_axis(values, order, axis=1), np.take_along_axis(vectors, order[:, None], axis=2)
    return found[0].astype(complex), found[1].astype(complex)


def _that_matter(A: Floats, B: Floats, C: Floats) -> Flags:
    """(s, n) states that something depends on and that move (`linear_loop.without_idle_states`)."""
    depends, matters = A != 0, (C != 0).any(axis=1)
    while True:
        grown = matters | (matters[:, :, None] & depends).any(axis=1)
        if (grown == matters).all():
            break
        matters = grown
    moves = depends.any(axis=2) & (np.eye(A.shape[1]) != A).any(axis=2)
    return matters & (moves | (B != 0).any(axis=2))


def _sizes(A: Floats) -> Floats:
    """Sizes of the states (s, n), powers of two, in which rows and columns of a matrix are alike."""
    size = np.ones(A.shape[:2])
    off = np.abs(A) * (1 - np.eye(A.shape[1]))
    for _ in range(6):
        scaled = off / size[:, :, None] * size[:, None, :]
        rows, columns = scaled.sum(axis=2), scaled.sum(axis=1)
        both = (rows > 0) & (columns > 0)
        ratio = np.sqrt(np.where(both, rows, 1.0) / np.where(both, columns, 1.0))
        size *= 2.0 ** np.round(np.log2(ratio))
    return size
