"""What the inputs can move and the sensors can see: the test of Popov, Belevitch and Hautus, mode by mode.

All measures are taken in balanced states (diagonal scaling), with every input and output of unit size, so that the
choice of units does not matter. They say what is possible with perfect sensors and unlimited inputs: a small but
positive number still asks for a sensor better by its inverse.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.linear.system import LinearSystem

Array = NDArray[np.float64]

LOST = 1e-11
"""Relative distance below which a mode is uncontrollable or unobservable: round-off."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """Matrices in balanced states.

    Attributes:
        A, B, C, D: matrices; the columns of B and the rows of C have unit length (or are zero).
        inputs, outputs: how many units of the system's input (output) one unit of the balanced one is.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: Array
    outputs: Array


def balanced(system: LinearSystem) -> Balanced:
    """A system in states scaled by powers of two so that rows and columns of A are alike in size."""
    from scipy.linalg import matrix_balance

    A, (scale, _) = matrix_balance(system.A, permute=False, separate=True)
    B, C = system.B / scale[:, None], system.C * scale
    inputs, outputs = 1 / _lengths(B.T), _lengths(C)
    return Balanced(A, B * inputs, C / outputs[:, None], system.D * inputs / outputs[:, None], inputs, outputs)


def _lengths(rows: Array) -> Array:
    lengths = np.linalg.norm(rows, axis=1)
    return np.where(lengths > 0, lengths, 1.0)


def mode_controllability(system: LinearSystem, inputs: Sequence[str] | None = None) -> Array:
    """Distance of every eigenvalue from being uncontrollable.

    Args:
        system: the system.
        inputs: those to use; default: all.

    Returns:
        Smallest singular value of ``[A - lambda I, B]`` over the norm of A, for the eigenvalues in the order of
        ``system.poles()`` (n); 0 but for round-off where no input moves the mode.

    Raises:
        ConfigurationError: an unknown input.
    """
    part = balanced(system.between(system.inputs if inputs is None else inputs, system.outputs))
    return _distances(part.A.T, part.B.T, system.poles())


def mode_observability(system: LinearSystem, outputs: Sequence[str] | None = None) -> Array:
    """Distance of every eigenvalue from being unobservable (see `mode_controllability`).

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
    """Whether the inputs (default: all) move every mode."""
    return bool(np.all(mode_controllability(system, inputs) > LOST))


def is_observable(system: LinearSystem, outputs: Sequence[str] | None = None) -> bool:
    """Whether the outputs (default: all) see every mode."""
    return bool(np.all(mode_observability(system, outputs) > LOST))


def sufficient_sensors(system: LinearSystem) -> tuple[tuple[str, ...], ...]:
    """The smallest sets of outputs from which every mode can be seen: none can spare an output.

    Sets of fewer outputs come first; empty where not even all outputs suffice.
    """
    return tuple(_smallest(system))


def _smallest(system: LinearSystem) -> Iterator[tuple[str, ...]]:
    found: list[tuple[str, ...]] = []
    for size in range(1, len(system.outputs) + 1):
        for chosen in combinations(system.outputs, size):
            if any(set(smaller) <= set(chosen) for smaller in found):
                continue
            if is_observable(system, chosen):
                found.append(chosen)
                yield chosen
