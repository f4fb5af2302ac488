"""Least squares of what filters did not expect, with their gains as they are: exact slopes, but not all logs say."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dualwinch.codegen.drivers.prediction import FilterPass
from dualwinch.identification.coordinates import Coordinates
from dualwinch.identification.levels import Levels
from dualwinch.identification.sections import Filters, all_completed
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

SOLVING = 5
"""Times that slopes are looked at with the same gains, at most."""

LOST = 1e12
"""Sum of squares of numbers with which a filter goes astray."""


class GivenGains:
    """The least-squares problem of logs whose filters have their gains."""

    def __init__(self, filters: Filters, machine: Callable[[Floats], Experiment], columns: Sequence[int]) -> None:
        """A problem of the logs that `filters` go through.

        Args:
            filters: they go through the logs.
            machine: gives the experiment with some values of the unknowns.
            columns: where the unknowns are among the numbers that filters take.
        """
        self._filters, self._machine, self._columns = filters, machine, list(columns)

    def normal(self, values: Floats, levels: Levels, weights: Sequence[FilterPass]) -> Floats:
        """(p + 1, p + 1) products of the slopes of all that is left by p unknowns, and of what is left, summed.

        NaN where filters go astray.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        experiment = self._machine(values)
        return self._normal(self._filters.vector(experiment, levels), experiment, levels, weights)

    def solved(
        self,
        values: Floats,
        levels: Levels,
        weights: Sequence[FilterPass],
        within: Coordinates,
        tolerance: float = 1e-8,
    ) -> tuple[Floats, Floats]:
        """Values that fit best, and the information of the logs there, (p, p).

        Args:
            values: (p,) where the search begins.
            levels: noise and scatter.
            weights: gains of the sections.
            within: gives ranges, and what is known beforehand.
            tolerance: change of the sum of squares, as a share, that ends the search.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        experiment = self._machine(values)
        base = self._filters.vector(experiment, levels)
        rows, centre = within.beforehand()
        last = dict[bytes, tuple[Floats, Floats, Floats]]()

        def squares(at: Floats) -> tuple[Floats, Floats, Floats]:
            key = at.tobytes()
            if key not in last:
                vector = base.copy()
                vector[self._columns] = within.values(at)
                normal = self._normal(vector, experiment, levels, weights)
                residual, slopes = _square_root(normal, within.slopes(at))
                last[key] = (
                    np.concatenate([residual, rows @ (at - centre)]),
                    np.concatenate([slopes, rows]),
                    normal,
                )
            return last[key]

        solver: Any = least_squares  # what is known of it knows no function as Jacobian
        found = solver(
            lambda at: squares(at)[0],
            within.of(values),
            lambda at: squares(at)[1],
            bounds=within.bounds,
            x_scale="jac",
            ftol=tolerance,
            xtol=10 * tolerance,
            max_nfev=SOLVING,
        ).x
        return within.values(found), squares(found)[2][:-1, :-1]

    def _normal(self, vector: Floats, experiment: Experiment, levels: Levels, weights: Sequence[FilterPass]) -> Floats:
        runs = self._filters.predict(vector, experiment, levels, weights)
        normal = np.sum([run.normal for run in runs], axis=0)
        return normal if all_completed(runs) else np.full_like(normal, np.nan)


def _square_root(normal: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """A problem of p + 1 rows, in coordinates with these slopes, that has the same squares as all readings have."""
    p = len(slopes)
    if not np.isfinite(normal).all() or normal[-1, -1] > LOST:
        return np.full(p + 1, np.sqrt(LOST)), np.zeros((p + 1, p))
    by = np.eye(p + 1)
    by[:p, :p] = slopes
    size, ways = np.linalg.eigh(by.T @ normal @ by)
    root = np.sqrt(np.maximum(size, 0.0))[:, np.newaxis] * ways.T
    return root[:, -1], root[:, :-1]
