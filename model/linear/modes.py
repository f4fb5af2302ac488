"""Modes of a linear system: how fast, how damped, in which states, and what to call them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.linear.mode_label import label
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant

Complex = NDArray[np.complex128]

STILL = 1e-8
"""Eigenvalues below this share of the largest are zero but for round-off (of a double one, its square root)."""

SAMPLES_A_PERIOD = 10
"""Samples in a period of a mode that a controller acting on it needs (Åström and Wittenmark: 10 to 30)."""


DEADBEAT = 1e-3
"""Eigenvalue of a discrete system below which a mode is gone after a sample and has no frequency."""


@dataclass(frozen=True)
class Mode:
    """One mode; an oscillation stands for both of its conjugate eigenvalues.

    Attributes:
        eigenvalue: of A: in 1/s, or per sample of a discrete system.
        rate: the same in 1/s; of a discrete system ``log(eigenvalue) / dt`` (minus infinity below `DEADBEAT`).
        participation: state → its share in the mode; the shares sum to one and do not depend on units.
        shape: state → complex amplitude; the states' units.
        label: in words, e.g. "rope 2 – drum 2".
    """

    eigenvalue: complex
    rate: complex
    participation: Mapping[str, float]
    shape: Mapping[str, complex]
    label: str

    @property
    def natural_frequency(self) -> float:
        """Natural frequency in rad/s."""
        return abs(self.rate)

    @property
    def damping(self) -> float:
        """Damping ratio: 1 and more for a decay without oscillation, 0 for what stays, negative for what grows."""
        if math.isinf(self.natural_frequency):
            return 1.0
        return -self.rate.real / self.natural_frequency if self.rate else 0.0

    @property
    def time_constant(self) -> float:
        """Time in s in which the mode falls to 1/e; infinite for what stays, negative for what grows."""
        return -1 / self.rate.real if self.rate.real else math.inf

    @property
    def sample_rate(self) -> float:
        """Sample rate in Hz with `SAMPLES_A_PERIOD` samples in a period of the natural frequency."""
        return SAMPLES_A_PERIOD * self.natural_frequency / (2 * math.pi)

    @property
    def main_states(self) -> tuple[str, ...]:
        """The states that make up the mode, the largest share first, until 90 % are told."""
        told, names = 0.0, []
        for name, share in sorted(self.participation.items(), key=lambda item: -item[1]):
            names.append(name)
            told += share
            if told >= 0.9:
                break
        return tuple(names)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """All eigenvalues of a system (n), with right eigenvectors (columns) and left ones (rows of the inverse).

    A chain of integrators, which has one eigenvector only, has a basis of its subspace instead.
    """

    eigenvalues: Complex
    right: Complex
    left: Complex


def modes(system: LinearSystem, plant: Plant | None = None) -> tuple[Mode, ...]:
    """Modes of a linear system, the slowest first.

    Args:
        system: the plant's or any other; where its states contain the plant's six, modes are labelled by their shape.
        plant: the plant that was linearised, for the labels (default: the paper's).
    """
    spectrum = spectra([system])[0]
    found = [
        mode(system, spectrum, k, plant or Plant())
        for k, eigenvalue in enumerate(spectrum.eigenvalues)
        if eigenvalue.imag >= 0
    ]
    return tuple(sorted(found, key=lambda entry: entry.natural_frequency))


def mode(system: LinearSystem, spectrum: Spectrum, k: int, plant: Plant) -> Mode:
    """The mode of the k-th eigenvalue of a spectrum."""
    eigenvalue = complex(spectrum.eigenvalues[k])
    shares = np.abs(spectrum.left[k] * spectrum.right[:, k])
    participation = dict(zip(system.states, (shares / shares.sum()).tolist(), strict=True))
    shape = dict(zip(system.states, spectrum.right[:, k].tolist(), strict=True))
    return Mode(
        eigenvalue, _rate(eigenvalue, system.dt), participation, shape, label(system, participation, shape, plant)
    )


def spectra(systems: Sequence[LinearSystem]) -> list[Spectrum]:
    """Eigenvalues and eigenvectors of systems of one size, all at once; rigid motion's eigenvalue is exactly zero."""
    matrices = np.array([system.A for system in systems])
    steady = np.array([0.0 if system.dt is None else 1.0 for system in systems])[:, None]
    eigenvalues, right = np.linalg.eig(matrices)
    still = np.abs(eigenvalues - steady) < STILL * np.abs(eigenvalues).max(axis=1, keepdims=True)
    eigenvalues = np.where(still, steady, eigenvalues)
    vectors = right.astype(np.complex128)
    for k in np.flatnonzero(still.sum(axis=1) > 1):
        vectors[k][:, still[k]] = _basis_of_still(matrices[k] - steady[k] * np.eye(len(matrices[k])), still[k].sum())
    left = np.linalg.pinv(vectors, rcond=1e-300)
    return [Spectrum(*entry) for entry in zip(eigenvalues.astype(np.complex128), vectors, left, strict=True)]


def _basis_of_still(A: NDArray[np.float64], count: int) -> Complex:
    """Basis of what does not decay: a chain of integrators has fewer eigenvectors than eigenvalues."""
    from scipy.linalg import matrix_balance, schur

    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    sizes = np.sort(np.abs(np.linalg.eigvals(balanced)))
    moving = sizes[count] if count < len(sizes) else np.inf
    between = np.sqrt(moving * max(sizes[count - 1], STILL * sizes[-1]))
    ordered: Any = schur(balanced, output="complex", sort=lambda rate: abs(rate) <= between)
    basis = scale[:, None] * ordered[1][:, :count]
    basis /= np.linalg.norm(basis, axis=0)
    # a chain's later vectors are free up to the first: with it, they show the displacement that the drift leads to
    basis[:, 1:] += basis[:, :1]
    return basis


def _rate(eigenvalue: complex, dt: float | None) -> complex:
    if dt is None:
        return eigenvalue
    return complex(np.log(eigenvalue)) / dt if abs(eigenvalue) > DEADBEAT else complex(-math.inf, 0.0)
