"""Modes followed along a sweep of operating points."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.linear.modes import Mode, Spectrum, mode, spectra
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant

CLEAR = 0.8
"""Overlap from which a mode is the one before beyond doubt."""


@dataclass(frozen=True)
class ModeTrack:
    """One mode along a sweep: at every point the mode, under the label it has most often."""

    label: str
    modes: tuple[Mode, ...]

    @property
    def natural_frequencies(self) -> NDArray[np.float64]:
        """Natural frequency in rad/s at every point."""
        return np.array([entry.natural_frequency for entry in self.modes])

    @property
    def dampings(self) -> NDArray[np.float64]:
        """Damping ratio at every point."""
        return np.array([entry.damping for entry in self.modes])

    @property
    def rates(self) -> NDArray[np.complex128]:
        """Continuous-time eigenvalue in 1/s at every point."""
        return np.array([entry.rate for entry in self.modes])


def track_modes(systems: Sequence[LinearSystem], plant: Plant | None = None) -> tuple[ModeTrack, ...]:
    """Follow the modes along systems that change little from one to the next.

    Two modes belong together where the left eigenvector of each fits the right one of the other (a measure that no
    scaling of states changes) and their eigenvalues are near. Where modes mix, as those of two equal ropes in the
    middle of the track do, they are matched with what they were before.

    Args:
        systems: of the same states, in the order of the sweep.
        plant: the plant that was linearised, for the labels (default: the paper's).

    Returns:
        The tracks, the slowest at the first point first. An oscillation is one track; where it splits into two
        decays, the other one is a track of its own.
    """
    from scipy.optimize import linear_sum_assignment

    found = spectra(systems)
    orders = [np.arange(len(found[0].eigenvalues))]
    known = Spectrum(found[0].eigenvalues, found[0].right.copy(), found[0].left.copy())
    for spectrum in found[1:]:
        overlap = np.abs(known.left @ spectrum.right) * np.abs(spectrum.left @ known.right).T
        distance = np.abs(known.eigenvalues[:, None] - spectrum.eigenvalues)
        scale = np.abs(known.eigenvalues[:, None]) + np.abs(spectrum.eigenvalues)
        cost = distance / np.maximum(scale, np.finfo(np.float64).tiny) - np.minimum(overlap, 1.0)
        order = linear_sum_assignment(cost)[1]
        orders.append(order)
        clear = overlap[np.arange(len(order)), order] > CLEAR
        known = Spectrum(
            spectrum.eigenvalues[order],
            np.where(clear, spectrum.right[:, order], known.right),
            np.where(clear[:, None], spectrum.left[order], known.left),
        )
    tracks = []
    for branch in np.array(orders).T:
        values = np.array([spectrum.eigenvalues[k] for spectrum, k in zip(found, branch, strict=True)])
        if np.all(values.imag < 0):
            continue
        along = tuple(
            mode(system, spectrum, int(k), plant or Plant())
            for system, spectrum, k in zip(systems, found, branch, strict=True)
        )
        tracks.append(ModeTrack(Counter(entry.label for entry in along).most_common(1)[0][0], along))
    return tuple(sorted(tracks, key=lambda track: track.modes[0].natural_frequency))
