"""Maximise the likelihood of the filters' innovations over noise covariances and parameters.

With fixed gains of the filters, the whitened innovations are a least-squares problem in the parameters with exact
derivatives, which leads near the maximum. But gains and variances depend on the parameters, too: Fisher scoring, over
parameters and noise together, accounts for that. At its end neighbours are compared along hardly correlated directions
of one standard deviation each, so that each has its own slope and curvature.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, lsq_linear

from dualwinch.toolbox import Experiment, progresses
from dualwinch.toolboxes.identification.filter import LogFilters, all_completed
from dualwinch.toolboxes.identification.noise import NoiseCoordinates
from dualwinch.toolboxes.identification.options import SearchOptions
from dualwinch.toolboxes.identification.prediction import FilterPass
from dualwinch.toolboxes.identification.predictor import NoiseCovariances
from dualwinch.toolboxes.identification.unknowns import SearchCoordinates

Floats = NDArray[np.float64]

NoiseCoordinatesAround = Callable[[NoiseCovariances], NoiseCoordinates]
"""Coordinates of the noise around some noise."""

LENGTHS = 2.0 ** np.arange(-3, 3)
"""Lengths of a step that are compared, over the expected one."""


@dataclass(frozen=True)
class WhitenedFrame:
    """Directions of one standard deviation each from a point, hardly correlated, by least squares with the gains there.

    Attributes:
        directions: (p, p) one a row, in coordinates; zero for a fixed coordinate.
        free: indices of the coordinates that are neither fixed nor at a bound, in the order of `root`.
        root: Cholesky factor of the information on them, priors included.
        information: (p, p) in coordinates, priors included.
        prior: (p, p) the share of the priors.
        units: (p, p) derivatives of the coordinates with respect to the unknowns.
    """

    directions: Floats
    free: NDArray[np.int_]
    root: Floats
    information: Floats
    prior: Floats
    units: Floats

    def information_with(self, curvatures: Floats) -> Floats:
        """(p, p) information of the logs alone, in units of the unknowns, with other curvatures along the directions.

        1 is that of least squares. Curvatures above 1 count as 1: mostly such a direction is curved, as that of an
        angle, and straight over only a part of the deviation.
        """
        information = self.information.copy()
        bent = np.clip(curvatures[self.free], 0.0, 1.0)
        information[np.ix_(self.free, self.free)] = (self.root * bent) @ self.root.T
        return self.units.T @ _positive_part(information - self.prior) @ self.units


@dataclass(frozen=True)
class PollResult:
    """The likeliest point of a poll.

    Attributes:
        at: (p,) its coordinates.
        deviance: the `Likelihood.objective` there.
        length: of the move there, the largest component along a direction, in standard deviations.
        newton: whether it is the end of a Newton step.
        curvatures: (p,) of half the deviance along the directions; 1 is that of least squares, NaN unknown.
    """

    at: Floats
    deviance: float
    length: float
    newton: bool
    curvatures: Floats


@dataclass(frozen=True)
class LikelihoodMaximum:
    """A local maximum of the likelihood.

    Attributes:
        at: (p,) coordinates.
        noise: R and Q with which it is one.
        deviance: minus twice the log-likelihood, up to a constant.
        information: (p, p) of the logs alone, in units of the unknowns (`WhitenedFrame.information_with`).
        converged: whether no neighbour is likelier.
    """

    at: Floats
    noise: NoiseCovariances
    deviance: float
    information: Floats
    converged: bool


class Likelihood:
    """The likelihood of logs and priors, over the unknowns in the coordinates of the search."""

    def __init__(
        self,
        filters: LogFilters,
        machine: Callable[[Floats], Experiment],
        columns: Sequence[int],
        options: SearchOptions,
    ) -> None:
        """Set up; `machine` makes an experiment from values, `columns` are their indices in the filters' parameters."""
        self._filters, self._machine, self._columns, self._options = filters, machine, list(columns), options
        self._last: tuple[Floats, NoiseCovariances | None, list[FilterPass]] = np.zeros(0), None, []

    def filtered(self, values: Floats, noise: NoiseCovariances) -> list[FilterPass]:
        """Passes at given values: those of the last call if it was for the same, else new ones in the same arrays."""
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
        """(p + 1, p + 1) normal equations: sums of products of the derivatives by p unknowns and the innovations.

        NaN if filters diverge. Initial states are those of the (p,) values, or of `start`.
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
    ) -> tuple[Floats, Floats]:
        """Least squares of the whitened innovations with fixed gains, within bounds (trust region reflective).

        Starts at (p,) values, and ends when the sum of squares, about the number of readings, falls by less than one.
        Unknowns without a prior get one with their scale as deviation, so that those the logs do not determine stay
        near their starts.

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
            ftol=1 / max(sum(int(np.isfinite(each.readings).sum()) for each in self._filters.sections), 1),
            xtol=None,
            max_nfev=self._options.max_evaluations,
        ).x
        return coordinates.values(found), squares(found)[2][:-1, :-1]

    def _square_root(self, normal: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        """(p + 1,) residuals and their Jacobian in coordinates, with the same sum of squares as all innovations."""
        p = len(jacobian)
        if not np.isfinite(normal).all():
            return np.full(p + 1, np.finfo(float).max ** 0.25), np.zeros((p + 1, p))
        by = np.eye(p + 1)
        by[:p, :p] = jacobian
        eigenvalues, vectors = np.linalg.eigh(by.T @ normal @ by)
        root = np.sqrt(np.maximum(eigenvalues, 0.0))[:, np.newaxis] * vectors.T
        return root[:, -1], root[:, :-1]

    def deviances(
        self,
        points: Sequence[Floats],
        noise: NoiseCovariances | Sequence[NoiseCovariances],
        coordinates: SearchCoordinates,
    ) -> Floats:
        """Minus twice the logarithm, up to a constant, at each of several points; infinite if filters diverge.

        All with the same noise, or each with its own.
        """
        noises = [noise] * len(points) if isinstance(noise, NoiseCovariances) else noise
        machines = [self._machine(coordinates.values(np.clip(point, *coordinates.bounds))) for point in points]
        logs = self._filters.deviances(list(zip(machines, noises, strict=True))) if machines else np.zeros(0)
        return logs + np.array([coordinates.prior_deviance(point) for point in points])

    def objective(
        self,
        points: Sequence[Floats],
        noise: NoiseCovariances | Sequence[NoiseCovariances],
        coordinates: SearchCoordinates,
    ) -> Floats:
        """The deviances of `deviances` with a prior for every unknown: without one, its scale is the deviation.

        Thereby unknowns that the logs do not determine stay near their starts, as in `solve_with_gains`.
        """
        free = 1.0 - coordinates.known
        shifts = [np.clip(point, *coordinates.bounds) - coordinates.start for point in points]
        return self.deviances(points, noise, coordinates) + np.array([free @ shift**2 for shift in shifts])

    def frame(
        self, at: Floats, noise: NoiseCovariances, coordinates: SearchCoordinates, fixed: int | None = None
    ) -> WhitenedFrame | None:
        """The whitened directions at (p,) coordinates, of which the one with the index `fixed` is kept.

        A coordinate at a bound has a direction of its own. ``None`` if filters diverge, or derivatives grow without
        limit, as they may when a rope slackens.
        """
        values, jacobian = coordinates.values(at), coordinates.jacobian(at)
        filtered = self.filtered(values, noise)
        normal = self.normal(values, noise, filtered)
        if not all_completed(filtered) or not np.isfinite(normal).all():
            return None
        rows, (lower, upper) = coordinates.prior_rows, coordinates.bounds
        prior = rows.T @ rows + np.diag(1.0 - coordinates.known)
        information = jacobian.T @ normal[:-1, :-1] @ jacobian + prior
        open_ended = np.arange(len(at)) != fixed
        free = np.flatnonzero((at > lower) & (at < upper) & open_ended)
        try:
            root = np.linalg.cholesky(information[np.ix_(free, free)])
        except np.linalg.LinAlgError:
            return None
        directions = np.diag(open_ended / np.sqrt(np.diag(information)))
        directions[np.ix_(free, free)] = np.linalg.inv(root)
        units = np.asarray(np.linalg.inv(jacobian), np.float64)
        return WhitenedFrame(directions, free, np.asarray(root, np.float64), information, prior, units)

    def poll(
        self,
        frame: WhitenedFrame,
        at: Floats,
        here: float,
        size: float,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
    ) -> PollResult:
        """The likeliest of the neighbours of a point and of the end of a Newton step from it.

        1. The deviance at `size` standard deviations ahead and behind along each direction of a frame gives its slope
           and curvature there; `here` is the `objective` at the (p,) coordinates themselves.
        2. The Newton step goes to the vertex of each parabola, at most twice the size away, and to the likelier
           neighbour where there is no vertex.
        """
        directions, bounds = frame.directions, coordinates.bounds
        steps = [np.clip(at + way * size * each, *bounds) for way in (1, -1) for each in directions]
        ahead, behind = self.objective(steps, noise, coordinates).reshape(2, -1)
        with np.errstate(invalid="ignore", divide="ignore"):
            curvatures = (ahead + behind - 2 * here) / (2 * size**2)
            vertices = (behind - ahead) / (4 * size * curvatures)
        lower = np.where(np.minimum(ahead, behind) < here, np.where(ahead < behind, size, -size), 0.0)
        inside = np.array([min(coordinates.room(at, way), coordinates.room(at, -way)) >= size for way in directions])
        curved = inside & np.isfinite(curvatures) & (curvatures > 0)
        lengths = np.where(curved, np.clip(vertices, -2 * size, 2 * size), lower)
        points = [np.clip(at + lengths @ directions, *bounds), *steps, at]
        deviances = [*self.objective(points[:1], noise, coordinates), *ahead, *behind, here]
        best = int(np.argmin(deviances))
        length = float(np.abs(lengths).max(initial=0.0)) if best == 0 else size
        return PollResult(
            at=points[best],
            deviance=float(deviances[best]),
            length=length,
            newton=best == 0,
            curvatures=np.where(inside & np.isfinite(curvatures), curvatures, np.nan),
        )

    def ascend(
        self,
        at: Floats,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
        fixed: int | None = None,
        accuracy: float = 1.0,
        around: NoiseCoordinatesAround | None = None,
        progress: progresses.Progress = progresses.no_progress,
    ) -> tuple[Floats, NoiseCovariances] | None:
        """A smooth maximum of the likelihood near (p,) coordinates; ``None`` if filters diverge.

        Fisher scoring (`LogFilters.scoring`) over all coordinates but the one with the index `fixed` and, with
        `around`, over the noise. Several lengths of each step are compared: in a curved valley with kinks, where a
        slope holds not far, longer ones lead on, and beyond a kink shorter ones. It ends where a step lowers the
        deviance by less than the square of `accuracy`.

        Returns:
            Coordinates and noise there.
        """
        if (frame := self.frame(at, noise, coordinates, fixed)) is None:
            return None
        movable = np.flatnonzero(np.arange(len(at)) != fixed)
        sizes = 1 / np.sqrt(np.diag(frame.information))[movable]
        (here,) = self.objective([at], noise, coordinates).tolist()
        for number in range(self._options.max_iterations):
            progress(number / (number + 2))
            logs = around(noise) if around else None
            model = self._scoring(at, noise, coordinates, logs, movable, sizes)
            if model is None:
                break
            information, slope = model
            sizes = 1 / np.sqrt(np.diag(information))[: len(movable)]
            lower, upper = (end[movable] - at[movable] for end in coordinates.bounds)
            if logs:
                lower = np.concatenate([lower, np.maximum(logs.bounds[0], -1.0)])
                upper = np.concatenate([upper, np.minimum(logs.bounds[1], 1.0)])
            step = _bounded_step(information, slope, lower, upper)
            moves = [np.clip(length * step, lower, upper) for length in LENGTHS.tolist()]
            points = [at.copy() for _ in moves]
            for point, move in zip(points, moves, strict=True):
                point[movable] += move[: len(movable)]
            noises = [logs.noise(move[len(movable) :]) if logs else noise for move in moves]
            objectives, falls = self.objective(points, noises, coordinates), np.full(len(moves), here)
            if logs:
                falls += logs.prior_deviance(np.zeros(len(logs)))
                falls -= [logs.prior_deviance(move[len(movable) :]) for move in moves]
            best = int(np.argmax(falls - objectives))
            fall = float(falls[best] - objectives[best])
            if fall > 0:
                at, noise, here = np.clip(points[best], *coordinates.bounds), noises[best], float(objectives[best])
            if fall < accuracy**2:
                break
        return at, noise

    def _scoring(
        self,
        at: Floats,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
        logs: NoiseCoordinates | None,
        movable: NDArray[np.int_],
        sizes: Floats,
    ) -> tuple[Floats, Floats] | None:
        """Expected information on some coordinates and those of the noise, and half the slope of the deviance.

        Priors are included. Differences are those by `sizes`; ``None`` if a filter diverges.
        """
        inward = np.where(at[movable] + sizes <= coordinates.bounds[1][movable], sizes, -sizes)
        points = [at.copy() for _ in movable]
        for point, index, size in zip(points, movable.tolist(), inward.tolist(), strict=True):
            point[index] += size
        candidates = [(self._machine(coordinates.values(point)), noise) for point in (at, *points)]
        rows = np.concatenate([coordinates.prior_rows, np.diag(1.0 - coordinates.known)])[:, movable]
        shift = (1.0 - coordinates.known) * (at - coordinates.start)
        residuals = np.concatenate([coordinates.prior_residuals(at), shift])
        if logs:
            steps = self._options.accuracy * np.eye(len(logs))
            candidates += [(candidates[0][0], logs.noise(step)) for step in steps]
            inward = np.concatenate([inward, np.full(len(logs), self._options.accuracy)])
            wider = np.zeros((len(logs.prior_rows), len(movable)))
            rows = np.block([[rows, np.zeros((len(rows), len(logs)))], [wider, logs.prior_rows]])
            residuals = np.concatenate([residuals, logs.prior_residuals])
        normal = self._filters.scoring(candidates, inward)
        if normal is None or not np.isfinite(normal).all():
            return None
        return normal[:-1, :-1] + rows.T @ rows, normal[:-1, -1] + rows.T @ residuals

    def maximum(
        self,
        at: Floats,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
        fixed: int | None = None,
        size: float | None = None,
        accuracy: float | None = None,
        around: NoiseCoordinatesAround | None = None,
        progress: progresses.Progress = progresses.no_progress,
    ) -> LikelihoodMaximum | None:
        """The local maximum of the likelihood near (p,) coordinates; ``None`` if filters diverge.

        For given noise, or over the noise, too, whose coordinates are `around` some noise.

        1. Ascend by Fisher scoring (`ascend`).
        2. Poll the neighbours (`poll`), first `size` standard deviations away (default: `SearchOptions.reach`) and then
           one, which gives the curvatures. Where a drum turns back or a rope slackens, the likelihood has kinks and
           jumps, at which slopes lead nowhere; polls go on from there to whatever neighbour is likelier: generating set
           search with Newton steps (Kolda, Lewis and Torczon, SIAM Review 45 (2003) 385). After a Newton step the next
           poll is as wide as that was long, or its square where that is shorter, as its error is; else as wide as the
           last ones. After more than one deviation, ascend again.
        3. End where no neighbour at a distance of `accuracy` (default: `SearchOptions.accuracy`) is likelier, or after
           `SearchOptions.max_iterations`.
        """
        options, end = self._options, accuracy or self._options.accuracy
        top = self.ascend(at, noise, coordinates, fixed, end, around, progresses.part(progress, 0.0, 0.5))
        frame = self.frame(*top, coordinates, fixed) if top else None
        if top is None or frame is None:
            return None
        at, noise = top
        here = float(self.objective([at], noise, coordinates)[0])
        curvatures, size, moved, converged = np.ones(len(at)), size or options.reach, 0.0, False
        for number in range(options.max_iterations):
            progress((1 + number / (number + 2)) / 2)
            result = self.poll(frame, at, here, size, noise, coordinates)
            if size == 1:
                curvatures = np.where(np.isnan(result.curvatures), curvatures, result.curvatures)
            fell = here - result.deviance > self._rounding(here)
            at, here, moved = result.at, result.deviance, moved + fell * result.length
            if converged := size == end and not fell and moved <= 1:
                break
            if moved > 1:
                at, noise = self.ascend(at, noise, coordinates, fixed, end, around) or (at, noise)
                here = float(self.objective([at], noise, coordinates)[0])
                size, moved, frame = 1.0, 0.0, self.frame(at, noise, coordinates, fixed) or frame
            elif size > 1:
                size = 1.0
            else:
                size = max(result.length * min(result.length, 1.0), end) if fell and result.newton else end
        (deviance,) = self.deviances([at], noise, coordinates).tolist()
        return LikelihoodMaximum(at, noise, deviance, frame.information_with(curvatures), converged)

    def _rounding(self, deviance: float) -> float:
        """Rounding error of a deviance at most, as a sum over all samples."""
        samples = sum(len(section.readings) for section in self._filters.sections)
        return samples * float(np.finfo(float).eps) * abs(deviance)


def _positive_part(information: Floats) -> Floats:
    """A symmetric matrix with its negative eigenvalues set to zero."""
    eigenvalues, vectors = np.linalg.eigh(information)
    return (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T


def _bounded_step(information: Floats, slope: Floats, lower: Floats, upper: Floats) -> Floats:
    """The minimum between bounds of a quadratic function, half of whose curvature and slope at zero are given.

    What has no curvature stays, as the noise of a sensor that process noise hides.
    """
    step, curved = np.zeros(len(slope)), np.flatnonzero((np.diag(information) > 0) & (lower < upper))
    scale = 1 / np.sqrt(np.diag(information))[curved]
    rounding = np.sqrt(np.finfo(float).eps) * np.eye(len(scale))
    root = np.linalg.cholesky(information[np.ix_(curved, curved)] * np.outer(scale, scale) + rounding)
    target = np.linalg.solve(root, -scale * slope[curved])
    step[curved] = scale * lsq_linear(root.T, target, (lower[curved] / scale, upper[curved] / scale)).x
    return step
