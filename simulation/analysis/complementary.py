"""Complementary sensitivities T = L/(1 + L) of many loops, at every cut, as sums over their poles and as they are.

Every margin is a distance of T from one half or from the real axis: the loop gain is 1 where Re T = 1/2, it is real
where T is, and the largest disk has the radius 1 / max|T - 1/2|. T of a loop closed at all cuts but for what is added
at one is stable where the loop is, so that its poles say where to look.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Complementary:
    """T at c cuts of s loops of one sample time.

    Attributes:
        A, B, C, D: closed loops, (s, n, n), (s, n, c), (s, c, n), (s, c): T = C (z - A)^-1 B + D, input and output of
            the same cut. A state that does not matter in one of them has zeros there.
        poles: (s, n) eigenvalues of A.
        residues: (s, c, n) of T at the poles.
        dt: sample time in s.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    poles: Complex
    residues: Complex
    dt: float

    @property
    def stable(self) -> Flags:
        """(s,) whether a loop is stable."""
        return np.abs(self.poles).max(axis=1, initial=0.0) < 1

    def quick(self, omega: Floats, loop: NDArray[np.intp]) -> Complex:
        """T as a sum over its poles at frequencies (a, k) in rad/s of loops (a,); (a, c, k)."""
        z = np.exp(1j * self.dt * omega)
        poles, residues = self.poles[loop], self.residues[loop]
        found = np.repeat(self.D[loop][:, :, None].astype(complex), omega.shape[1], axis=2)
        for index in range(poles.shape[1]):
            found += residues[:, :, index, None] / (z - poles[:, index, None])[:, None]
        return found

    def quick_with_slope(self, omega: Floats, loop: NDArray[np.intp], cut: NDArray[np.intp]) -> tuple[Complex, Complex]:
        """T and dT/d omega as sums over poles at one frequency each, (a,)."""
        z = np.exp(1j * self.dt * omega)
        apart = z[:, None] - self.poles[loop]
        terms = self.residues[loop, cut] / apart
        return terms.sum(axis=1) + self.D[loop, cut], -1j * self.dt * z * (terms / apart).sum(axis=1)

    def exact_with_slope(self, omega: Floats, loop: NDArray[np.intp], cut: NDArray[np.intp]) -> tuple[Complex, Complex]:
        """The same from the matrices, as exact as they are."""
        z = np.exp(1j * self.dt * omega)
        pencil = z[:, None, None] * np.eye(self.A.shape[1]) - self.A[loop]
        row, column = self.C[loop, cut], self.B[loop, :, cut]
        right = np.linalg.solve(pencil, column[:, :, None].astype(complex))
        again = np.linalg.solve(pencil, right)
        value = np.einsum("an,an->a", row, right[..., 0]) + self.D[loop, cut]
        return value, -1j * self.dt * z * np.einsum("an,an->a", row, again[..., 0])


def complementary(A: Floats, B: Floats, C: Floats, D: Floats, dt: float) -> Complementary:
    """T of loops that are open at all c cuts.

    Args:
        A: of the states, (s, n, n).
        B: by what leaves the cuts, (s, n, c).
        C: of what comes back to them, (s, c, n).
        D: of the one by the other, (s, c, c).
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
    poles, vectors = np.linalg.eig(closed / size[:, :, None] * size[:, None, :])
    weights = np.linalg.solve(vectors, (entered / size[:, :, None]).astype(complex))
    residues = (-(C * size[:, None, :] @ vectors) * np.swapaxes(weights, 1, 2)).astype(complex)
    direct = -np.einsum("scc->sc", through @ D)
    return Complementary(closed, entered, -C, direct, poles, residues, dt)


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
