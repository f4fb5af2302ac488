"""The likelihood of the filters' innovations: least squares with given gains, and Newton steps by differences.

With the gains of the filters given, the whitened innovations are a least-squares problem with exact derivatives, which
leads near the maximum. But gains and variances depend on the parameters, too. Differences of the likelihood itself
account for that. They are taken along directions of one standard deviation each that are hardly correlated, so that
each has its own slope and curvature; directions in which least squares turn out to be right are not differenced again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dualwinch.codegen.drivers.prediction import FilterPass
from dualwinch.identification.filter import LogFilters, all_completed
from dualwinch.identification.options import SearchOptions
from dualwinch.identification.predictor import NoiseCovariances
from dualwinch.identification.unknowns import SearchCoordinates
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class NewtonStep:
    """A Newton step of the deviance: minus twice the log-likelihood, but for a constant.

    Attributes:
        at: (p,) coordinates where it leads.
        deviance: there.
        fall: by how much it fell.
        expected_fall: by how much it should have fallen.
        slopes: (p,) slopes of half of it along the directions, less those of least squares.
        curvatures: (p,) likewise second derivatives; 1 is what least squares have.
        information: (p, p) where it begins, of the logs alone, in units of the unknowns, with these curvatures. One
            above 1 counts as 1: mostly that is a direction that turns, as an angle's does, and is straight for a part
            of the deviation only.
    """

    at: Floats
    deviance: float
    fall: float
    expected_fall: float
    slopes: Floats
    curvatures: Floats
    information: Floats


class Likelihood:
    """The likelihood of logs and priors; the unknowns in the coordinates of a search."""

    def __init__(
        self,
        filters: LogFilters,
        machine: Callable[[Floats], Experiment],
        columns: Sequence[int],
        options: SearchOptions,
    ) -> None:
        """A likelihood; `machine` makes an experiment of values, `columns` are these among the filters' parameters."""
        self._filters, self._machine, self._columns, self._options = filters, machine, list(columns), options
        self._last: tuple[Floats, NoiseCovariances | None, list[FilterPass]] = np.zeros(0), None, []

    def filtered(self, values: Floats, noise: NoiseCovariances) -> list[FilterPass]:
        """Passes at some values; those of the last call where it was for the same, else in the place of them."""
        parameters = self._filters.parameters(self._machine(values), noise)
        last_parameters, last_noise, filtered = self._last
        if last_noise is not noise or not np.array_equal(parameters, last_parameters):
            filtered = self._filters.run(self._machine(values), noise, into=filtered)
            self._last = parameters, noise, filtered
        return filtered

    def normal(
        self,
        values: Floats,
        noise: NoiseCovariances,
        filtered: Sequence[FilterPass],
        start: Floats | None = None,
    ) -> Floats:
        """(p + 1, p + 1) normal equations: products of the derivatives by p unknowns, and of the innovations, summed.

        NaN where filters diverge. The machine with the (p,) values, or with those of `start`, gives the initial states.
        """
        experiment = self._machine(values if start is None else start)
        parameters = self._filters.parameters(experiment, noise)
        parameters[self._columns] = values
        runs = self._filters.predict(parameters, experiment, noise, filtered)
        normal = np.sum([run.normal for run in runs], axis=0)
        return normal if all_completed(runs) else np.full_like(normal, np.nan)

    def solve_with_gains(
        self,
        values: Floats,
        noise: NoiseCovariances,
        filtered: Sequence[FilterPass],
        coordinates: SearchCoordinates,
        tolerance: float = 1e-8,
    ) -> tuple[Floats, Floats]:
        """Least squares of the whitened innovations with given gains, within bounds (trust region reflective).

        Begins at (p,) values, and ends where the sum of squares changes by less than a relative `tolerance`. Unknowns
        without a prior are held near their starts by one as wide as their scale: what logs do not determine stays.

        Returns:
            (p,) values, and (p, p) information of the logs.
        """
        last, free = dict[bytes, tuple[Floats, Floats, Floats]](), 1.0 - coordinates.known
        rows = np.concatenate([coordinates.prior_rows, np.diag(free)])

        def squares(at: Floats) -> tuple[Floats, Floats, Floats]:
            key = at.tobytes()
            if key not in last:
                normal = self.normal(coordinates.values(at), noise, filtered, start=values)
                residual, jacobian = self._square_root(normal, coordinates.jacobian(at))
                residual = np.concatenate([residual, coordinates.prior_residuals(at), free * (at - coordinates.start)])
                last[key] = residual, np.concatenate([jacobian, rows]), normal
            return last[key]

        solver: Any = least_squares  # its stub lacks the function that returns the Jacobian
        found = solver(
            lambda at: squares(at)[0],
            coordinates.of(values),
            lambda at: squares(at)[1],
            bounds=coordinates.bounds,
            x_scale="jac",
            ftol=tolerance,
            xtol=10 * tolerance,
            max_nfev=self._options.evaluations,
        ).x
        return coordinates.values(found), squares(found)[2][:-1, :-1]

    def _square_root(self, normal: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        """Residuals (p + 1,) and their Jacobian in some coordinates, with the same squares as all innovations have."""
        p, largest = len(jacobian), self._options.largest_sum
        if not np.isfinite(normal).all() or normal[-1, -1] > largest:
            return np.full(p + 1, np.sqrt(largest)), np.zeros((p + 1, p))
        by = np.eye(p + 1)
        by[:p, :p] = jacobian
        eigenvalues, vectors = np.linalg.eigh(by.T @ normal @ by)
        root = np.sqrt(np.maximum(eigenvalues, 0.0))[:, np.newaxis] * vectors.T
        return root[:, -1], root[:, :-1]

    def deviances(self, points: Sequence[Floats], noise: NoiseCovariances, coordinates: SearchCoordinates) -> Floats:
        """Minus twice the logarithm, but for a constant, at each of some points; infinite where filters diverge."""
        machines = [self._machine(coordinates.values(np.clip(point, *coordinates.bounds))) for point in points]
        logs = self._filters.deviances(machines, noise) if machines else np.zeros(0)
        return logs + np.array([_prior_deviance(point, coordinates) for point in points])

    def step(
        self,
        at: Floats,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
        before: NewtonStep | None = None,
        fixed: int | None = None,
    ) -> NewtonStep | None:
        """One Newton step towards the maximum of the likelihood; None: filters diverge where it would begin.

        1. Least squares with the gains at this point give a gradient and an information matrix, whose Cholesky factor
           gives directions of one standard deviation each.
        2. Differences of the likelihood along these correct slope and curvature.
        3. The step is halved while it does not lower the deviance. Where no length does, the step of least squares is
           taken instead.

        Args:
            at: (p,) coordinates.
            noise: R and Q.
            coordinates: of the unknowns.
            before: the last step; directions in which it corrected nothing are not differenced.
            fixed: index of a coordinate that stays as it is.
        """
        values, jacobian = coordinates.values(at), coordinates.jacobian(at)
        filtered = self.filtered(values, noise)
        normal = self.normal(values, noise, filtered)
        if not all_completed(filtered) or not np.isfinite(normal).all():
            return None
        rows = coordinates.prior_rows
        prior = rows.T @ rows + np.diag(1.0 - coordinates.known)
        gradient = jacobian.T @ normal[:-1, -1] + rows.T @ coordinates.prior_residuals(at)
        known = jacobian.T @ normal[:-1, :-1] @ jacobian + prior
        lower, upper = coordinates.bounds
        free = np.flatnonzero((at > lower) & (at < upper) & (np.arange(len(at)) != fixed))
        block = np.ix_(free, free)
        try:
            root = np.linalg.cholesky(known[block])
        except np.linalg.LinAlgError:  # derivatives that have grown beyond all measure, as where a rope slackens
            return None
        directions = np.zeros_like(known)
        directions[block] = np.linalg.inv(root)
        least, most = self._options.least_difference, self._options.difference
        reach = np.array([min(coordinates.room(at, way), coordinates.room(at, -way), most) for way in directions])
        here = 2 * sum(each.negative_log_likelihood for each in filtered) + _prior_deviance(at, coordinates)
        plain = directions @ gradient
        slopes, curvatures = self._differences(at, here, directions, reach, plain, noise, coordinates, before)
        # a kink of the likelihood, as where a rope slackens, makes differences useless: then least squares alone
        move, there, expected = np.zeros_like(at), here, 0.0
        for more, bent in ((slopes, curvatures), (np.zeros_like(slopes), np.ones_like(curvatures))):
            way = np.where(reach > least, -(plain + more) / bent, 0.0) @ directions
            way *= min(coordinates.room(at, way), 1.0)
            hoped = float(np.where(reach > least, (plain + more) ** 2 / bent, 0.0).sum())
            move, there = self._shortened(at, here, way, hoped, noise, coordinates)
            if more is slopes or there < here:
                expected = hoped
            if there < here or expected < self._options.large_gain:
                break
        back = np.linalg.inv(jacobian)
        known[block] = (root * np.minimum(curvatures[free], 1.0)) @ root.T
        information = back.T @ _positive_part(known - prior) @ back
        at = np.clip(at + move, *coordinates.bounds)
        return NewtonStep(at, there, here - there, expected, slopes, curvatures, information)

    def _shortened(
        self,
        at: Floats,
        here: float,
        move: Floats,
        expected: float,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
    ) -> tuple[Floats, float]:
        """A move, halved until the deviance falls, or none, and the deviance where it leads.

        Where next to nothing is expected, it is not checked.
        """
        options = self._options
        if expected < options.small_gain:
            return move, here - expected
        for _ in range(options.insistent_halvings if expected > options.large_gain else options.halvings):
            there = float(self.deviances([at + move], noise, coordinates)[0])
            if there <= here:
                return move, there
            move = move / 2
        return np.zeros_like(at), here

    def _differences(
        self,
        at: Floats,
        here: float,
        directions: Floats,
        reach: Floats,
        plain: Floats,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
        before: NewtonStep | None,
    ) -> tuple[Floats, Floats]:
        """Along each direction the slope beyond the plain one of least squares, and the curvature."""
        negligible = self._options.negligible
        last_slopes, last_curvatures = np.zeros(len(at)), np.ones(len(at))
        wanted = (reach > self._options.least_difference) & directions.any(axis=1)
        if before is not None:
            last_slopes, last_curvatures = before.slopes, before.curvatures
            wanted &= (np.abs(last_slopes) > negligible) | (np.abs(last_curvatures - 1) > negligible)
        ahead, behind = np.full(len(at), np.nan), np.full(len(at), np.nan)
        ahead[wanted] = self.deviances([*(at + (reach[:, np.newaxis] * directions)[wanted])], noise, coordinates)
        ahead[np.isinf(ahead)] = np.nan
        slopes = (ahead - here) / (2 * reach) - reach / 2 - plain
        wanted &= ~(np.abs(slopes) < negligible)
        behind[wanted] = self.deviances([*(at - (reach[:, np.newaxis] * directions)[wanted])], noise, coordinates)
        behind[np.isinf(behind)] = np.nan
        central, curvatures = (ahead - behind) / (4 * reach), (ahead + behind - 2 * here) / (2 * reach**2)
        slopes = np.where(np.isfinite(slopes), slopes, last_slopes)
        slopes = np.where(np.isfinite(central), central - plain, slopes)
        least = self._options.least_curvature
        curvatures = np.where(np.isfinite(central), np.maximum(curvatures, least), last_curvatures)
        return slopes, curvatures


def _prior_deviance(at: Floats, coordinates: SearchCoordinates) -> float:
    return float(np.sum(coordinates.prior_residuals(at) ** 2))


def _positive_part(information: Floats) -> Floats:
    """A symmetric matrix with its negative eigenvalues set to zero."""
    eigenvalues, vectors = np.linalg.eigh(information)
    return (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
