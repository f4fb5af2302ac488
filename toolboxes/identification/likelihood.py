"""Maximise the likelihood of the filters' innovations over noise covariances and parameters.

R is estimated by expectation maximisation, Q by line searches of the likelihood.

With fixed gains of the filters, the whitened innovations are a least-squares problem in the parameters with exact
derivatives, which leads near the maximum. But gains and variances depend on the parameters, too: Newton steps by
differences of the likelihood itself account for that. Differences are taken along hardly correlated directions of one
standard deviation each, so that each has its own slope and curvature.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar

from dualwinch.toolbox import Experiment, progresses, sensing
from dualwinch.toolboxes.identification.filter import LogFilters, all_completed, deviance_of
from dualwinch.toolboxes.identification.options import NoiseOptions, SearchOptions
from dualwinch.toolboxes.identification.prediction import FilterPass
from dualwinch.toolboxes.identification.predictor import READINGS, VORTICES, NoiseCovariances, described_disturbances
from dualwinch.toolboxes.identification.unknowns import SearchCoordinates

Floats = NDArray[np.float64]

NORMAL_MEDIAN = 0.6745
"""Median of a standard normal variable's magnitude."""

NEGLIGIBLE_FALL = 0.05
"""Expected fall of half the deviance for which noise is not searched further."""

LOAD_CELLS = ("F1", "F2")
"""Sensors that are quiet only while torques are."""

ESTIMATED = (("force",), ("torque_1", "torque_2"))
"""Disturbances that no experiment describes, in groups with a common estimated deviation."""

DESCRIBED = ("current", "normal_force_variation")
"""Disturbances that an experiment describes; deviations and correlation times have priors around the described ones."""

SIZE, TIME, TIME_ALONE = np.array([1.0, 0.0]), np.array([0.5, 1.0]), np.array([0.0, 1.0])
"""Search directions for the logarithms of deviation and correlation time: the deviation; the time with a constant
variance added per sample, which a log determines best; and the time alone."""


def min_noise(options: NoiseOptions) -> Floats:
    """(readings,) least standard deviations of the sensors' noise, as neither sensors nor model are perfect."""
    finest = {
        "x": options.min_position_noise,
        "v": options.min_speed_noise,
        "F1": options.min_tension_noise,
        "F2": options.min_tension_noise,
        "theta_1": options.min_angle_noise,
        "theta_2": options.min_angle_noise,
        "omega_1": options.min_drum_speed_noise,
        "omega_2": options.min_drum_speed_noise,
    }
    return np.array([finest[name] for name in READINGS])


def initial_measurement_noise(readings: Floats, sensors: sensing.Sensors, options: NoiseOptions) -> Floats:
    """(readings,) initial variances of all sensors.

    As described by the experiment, quantisation included; for sensors described as perfect, from differences between
    the log's samples.
    """
    described = {
        "x": math.hypot(sensors.position_noise, sensors.position_resolution / math.sqrt(12)),
        "v": sensors.speed_noise,
        "F1": sensors.tension_noise,
        "F2": sensors.tension_noise,
    }
    deviations = noise_by_differences(readings, options)
    for index, (name, finest) in enumerate(zip(READINGS, min_noise(options).tolist(), strict=True)):
        if described.get(name, 0.0) > 0:
            deviations[index] = max(described[name], finest)
    return deviations**2


def noise_by_differences(readings: Floats, options: NoiseOptions) -> Floats:
    """(readings,) standard deviations of all sensors' noise, by third differences, which cancel most of a motion."""
    own = [
        _white_noise(values[np.isfinite(values)], options, options.quiet_share if name in LOAD_CELLS else 1.0)
        for name, values in zip(READINGS, readings.T, strict=True)
    ]
    return np.maximum(own, min_noise(options))


def _white_noise(values: Floats, options: NoiseOptions, quiet: float) -> float:
    """Standard deviation of white noise by third differences; for a quantised sensor at least that of rounding."""
    if len(values) < 10:
        return 0.0
    steps = np.abs(np.diff(values))
    least = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
    jumps = np.abs(np.diff(values, 3))
    if quiet < 1 and len(jumps) >= 2 * options.quiet_readings:
        windows = np.array_split(jumps, len(jumps) // options.quiet_readings)
        quietest = sorted(windows, key=lambda each: float(np.median(each)))
        jumps = np.concatenate(quietest[: max(1, round(quiet * len(windows)))])
    deviation = float(np.median(jumps)) / NORMAL_MEDIAN / math.sqrt(20)
    counts = least > 0 and np.allclose(np.rint(steps / least), steps / least, atol=1e-3)
    return max(deviation, least / math.sqrt(12)) if counts else deviation


def _minimum_between(
    cost: Callable[[float], float], ends: tuple[float, float], tolerance: float, evaluations: int
) -> tuple[float, float]:
    """Minimise a cost between two ends by Brent's method; returns the minimum and its cost."""
    options = {"xatol": tolerance, "maxiter": evaluations}
    best: Any = minimize_scalar(cost, bounds=ends, method="bounded", options=options)
    return float(best.x), float(best.fun)


def minimum_nearby(
    cost: Callable[[float], float],
    here: tuple[float, float],
    step: float,
    ends: tuple[float, float],
    tolerance: float,
    evaluations: int,
    *,
    evaluate_last: bool = True,
) -> tuple[float, float]:
    """Minimise a cost between two ends by steps downhill, each twice the last, and parabolas.

    A search that starts near a minimum, as most do, ends after two or three evaluations.

    Args:
        cost: the cost.
        here: where to start, and its cost.
        step: the first step.
        ends: the range.
        tolerance: distance of a parabola's minimum from the best point so far below which it is the last one.
        evaluations: largest number of them.
        evaluate_last: whether that last one is evaluated; without is faster, but unsafe where the cost is irregular.

    Returns:
        The minimum, and its cost.
    """
    known = dict([here])

    def evaluated(at: float) -> float:
        at = min(max(at, ends[0]), ends[1])
        if at not in known:
            known[at] = cost(at)
        return at

    def best() -> float:
        return min(known, key=lambda at: known[at])

    for way in (1.0, -1.0):
        ahead, reach = here[0], step
        while len(known) <= evaluations and evaluated(ahead + way * reach) == best() != ahead:
            ahead, reach = best(), 2 * reach
        if ahead != here[0]:
            break
    distance = math.inf
    while len(known) <= evaluations and distance >= tolerance and min(known) < best() < max(known):  # not at an end
        middle = best()
        at, least = _vertex(known, middle)
        if not evaluate_last and abs(at - middle) < tolerance:
            return at, least
        if evaluate_last and known[middle] - least < NEGLIGIBLE_FALL:
            break
        distance = abs(evaluated(at) - middle)
    return best(), known[best()]


def _vertex(known: dict[float, float], b: float) -> tuple[float, float]:
    """Minimum of a parabola through the lowest of known points and its two neighbours; and its value."""
    a, c = max(at for at in known if at < b), min(at for at in known if at > b)
    of_a, of_b, of_c = known[a], known[b], known[c]
    before, behind = (of_b - of_a) / (b - a), (of_c - of_b) / (c - b)
    curvature = (behind - before) / (c - a)
    if not curvature > 0:  # flat
        return b, of_b
    slope = before + curvature * (b - a)
    return b - slope / (2 * curvature), of_b - slope**2 / (4 * curvature)


class NoiseEstimator:
    """Estimates R and Q for approximately known parameters."""

    def __init__(self, filters: LogFilters, experiment: Experiment, options: NoiseOptions) -> None:
        """Set up; the least deviations are those that the experiment describes."""
        self._filters, self._options = filters, options
        self._described = described_disturbances(experiment, options)
        self._least = {name: each.deviation for name, each in self._described.items()}
        self._samples = round(options.section_time / experiment.simulation.sample_time)

    def tolerable(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """The least process noise of a grid with which no filter diverges; as given if there is none."""
        wider = sorted(self._grid(noise), key=lambda each: each.process["torque_1"].deviation)
        return next((each for each in wider if all_completed(self._filter(experiment, each, None))), noise)

    def with_process_noise(
        self, experiment: Experiment, noise: NoiseCovariances, *, anywhere: bool = False, roughly: bool = False
    ) -> NoiseCovariances:
        """Estimate Q of the disturbances that no experiment describes, by maximum likelihood.

        The search begins with the given Q or, if `anywhere`, with the best of a grid over the whole range. A rough one
        uses the beginning of each section only.
        """
        samples = self._samples if roughly else None
        if anywhere:
            noise, here = self._likeliest(experiment, self._grid(noise), samples)
        else:
            here = self._cost(experiment, noise, samples)
        for names in ESTIMATED:
            noise, here = self._line_search(experiment, noise, names, samples, here)
        return noise

    def with_torque_noise(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """Estimate Q of the unrecorded torques only, roughly, over its whole range.

        Errors of parameters that are not yet estimated well must not be attributed to an unrecorded force.
        """
        torques = ESTIMATED[1]
        grid = [self._scaled(noise, torques, factor) for factor in self._factors]
        best, cost = self._likeliest(experiment, grid, self._samples)
        return self._line_search(experiment, best, torques, self._samples, cost)[0]

    def with_sea(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """Estimate deviation and correlation time of described disturbances, by maximum likelihood.

        Their priors are log-normal around the described values. Where noise still has these, searches go over the whole
        range, else around the values it has.
        """
        options, reach = self._options, math.log(self._options.described_reach)
        anywhere = options.whole_range or all(noise.process[name] == self._described[name] for name in DESCRIBED)
        factors = (SIZE, options.described_factor), (TIME, options.described_time_factor)
        searches = [(name, way, factor, reach) for name in DESCRIBED for way, factor in factors]
        searches.append((VORTICES, TIME_ALONE, options.vortex_time_factor, 3 * math.log(options.vortex_time_factor)))

        def whole(noise: NoiseCovariances) -> float:
            return self._cost(experiment, noise, None) + self._negative_log_prior(experiment, noise)

        here = None
        for name, way, factor, reach in searches:
            if factor == 1 or noise.process[name].deviation == 0:
                continue

            def moved(by: float, name: str = name, way: Floats = way, noise: Any = noise) -> NoiseCovariances:
                process = noise.process[name].scaled(*np.exp(by * way).tolist())
                return replace(noise, process={**noise.process, name: process})

            def cost(by: float, moved: Callable[[float], NoiseCovariances] = moved) -> float:
                return whole(moved(by))

            accuracy = options.described_tolerance, options.max_described_evaluations
            if anywhere:
                best, here = _minimum_between(cost, (-reach, reach), *accuracy)
            else:
                step, start = math.log(options.described_step), (0.0, whole(noise) if here is None else here)
                best, here = minimum_nearby(cost, start, step, (-reach, reach), *accuracy)
            noise = moved(best) if best else noise
        return noise

    def _negative_log_prior(self, experiment: Experiment, noise: NoiseCovariances) -> float:
        """Negative logarithm of the prior density of the described disturbances, up to a constant."""
        process, options, total = noise.process_of(experiment.plant.vehicle), self._options, 0.0
        of_sea = dict.fromkeys(DESCRIBED, (options.described_factor, options.described_time_factor))
        factors = {**of_sea, VORTICES: (1.0, options.vortex_time_factor)}
        for name, (of_size, of_time) in factors.items():
            own, described = process[name], self._described[name]
            pairs = (own.deviation, described.deviation, of_size), (own.time, described.time, of_time)
            for value, usual, factor in pairs if own.deviation > 0 else ():
                total += (math.log(value / usual) / math.log(factor)) ** 2 / 2 if factor > 1 else 0.0
        return total

    @property
    def _factors(self) -> list[float]:
        """Grid of factors on the least deviation, over its whole range."""
        options = self._options
        return (options.grid ** np.arange(np.ceil(np.log(options.range) / np.log(options.grid)))).tolist()

    def _grid(self, noise: NoiseCovariances) -> list[NoiseCovariances]:
        """Deviations of all groups on a grid over their range."""
        return [
            reduce(lambda found, pair: self._scaled(found, *pair), zip(ESTIMATED, chosen, strict=True), noise)
            for chosen in product(self._factors, repeat=len(ESTIMATED))
        ]

    def _line_search(
        self, experiment: Experiment, noise: NoiseCovariances, names: Sequence[str], samples: int | None, here: float
    ) -> tuple[NoiseCovariances, float]:
        """The likeliest deviation of one group near the present one, whose cost is `here`; and the cost with it."""
        options, now = self._options, np.log(noise.process[names[0]].deviation / self._least[names[0]])
        reach, accuracy = np.log(options.grid), (options.line_tolerance, options.max_line_evaluations)
        ends = float(max(now - reach, 0.0)), float(min(now + reach, np.log(options.range)))

        def cost_of(factor: float) -> float:
            return self._cost(experiment, self._scaled(noise, names, np.exp(factor)), samples)

        if options.whole_range:
            best, cost = _minimum_between(cost_of, ends, *accuracy)
        else:
            start = float(now), here
            best, cost = minimum_nearby(cost_of, start, reach / 4, ends, *accuracy, evaluate_last=samples is None)
        return self._scaled(noise, names, np.exp(best)) if best != now else noise, cost

    def _scaled(self, noise: NoiseCovariances, names: Sequence[str], factor: float) -> NoiseCovariances:
        """The noise with a group's deviation as a multiple of its least one."""
        deviation = float(factor) * self._least[names[0]]
        scaled = {name: replace(noise.process[name], deviation=deviation) for name in names}
        return replace(noise, process={**noise.process, **scaled})

    def _likeliest(
        self, experiment: Experiment, noises: Sequence[NoiseCovariances], samples: int | None
    ) -> tuple[NoiseCovariances, float]:
        """The likeliest of several, and its cost; all of them in parallel."""
        deviances = self._filters.deviances([(experiment, noise) for noise in noises], samples)
        best = int(np.argmin(deviances))
        return noises[best], min(float(deviances[best]) / 2, self._options.diverged_likelihood)

    def _cost(self, experiment: Experiment, noise: NoiseCovariances, samples: int | None) -> float:
        filtered = self._filter(experiment, noise, samples)
        if not all_completed(filtered):
            return self._options.diverged_likelihood
        return sum(each.negative_log_likelihood for each in filtered)

    def with_measurement_noise(
        self, experiment: Experiment, noise: NoiseCovariances, filtered: Sequence[FilterPass]
    ) -> NoiseCovariances:
        """Estimate R by expectation maximisation, starting from passes with the given noise.

        Its steps shrink slowly where process noise explains as much as a sensor's. SQUAREM (Varadhan and Roland,
        Scand. J. Stat. 35 (2008) 335) extrapolates the logarithms of the variances from two steps, if that is likelier.
        It ends once that hardly lowers the deviance.
        """
        cost = deviance_of(filtered) / 2
        least, largest = 2 * np.log(min_noise(self._options)), np.log(np.finfo(float).max) / 2
        for _ in range(self._options.max_em_steps):
            steps = [noise, first := self._em_step(noise, filtered)]
            filtered = self._filter(experiment, first, None)
            steps.append(self._em_step(first, filtered))
            logs = np.log([each.measurement for each in steps])
            step, bend = logs[1] - logs[0], logs[2] - 2 * logs[1] + logs[0]
            rounding = np.spacing(np.linalg.norm(logs[0]))  # a smaller bend is none
            length = max(float(np.linalg.norm(step) / max(np.linalg.norm(bend), rounding)), 1.0)
            ahead = np.clip(logs[0] + 2 * length * step + length**2 * bend, least, largest)
            candidates = [replace(noise, measurement=np.exp(ahead)), steps[2]]
            runs = [self._filter(experiment, each, None) for each in candidates]
            costs = [deviance_of(each) / 2 if all_completed(each) else np.inf for each in runs]
            likeliest, before = int(np.argmin(costs)), cost
            noise, filtered, cost = candidates[likeliest], runs[likeliest], costs[likeliest]
            if before - cost < NEGLIGIBLE_FALL:
                break
        return noise

    def _em_step(self, noise: NoiseCovariances, filtered: Sequence[FilterPass]) -> NoiseCovariances:
        """One step of expectation maximisation for R."""
        counts = np.sum([each.counts for each in filtered], axis=0)
        squares = np.sum([np.nan_to_num(each.noise * each.counts) for each in filtered], axis=0)
        variances = np.where(counts > 0, squares / np.maximum(counts, 1), noise.measurement)
        return replace(noise, measurement=np.maximum(variances, min_noise(self._options) ** 2))

    def _filter(self, experiment: Experiment, noise: NoiseCovariances, samples: int | None) -> list[FilterPass]:
        return self._filters.run(experiment, noise, gains=False, samples=samples)


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
        likelier: whether a polled neighbour is likelier than the point that was polled from.
    """

    at: Floats
    deviance: float
    length: float
    newton: bool
    curvatures: Floats
    likelier: bool


@dataclass(frozen=True)
class LikelihoodMaximum:
    """A local maximum of the likelihood for given noise.

    Attributes:
        at: (p,) coordinates.
        deviance: minus twice the log-likelihood, up to a constant.
        fall: of the deviance on the way there.
        information: (p, p) of the logs alone, in units of the unknowns (`WhitenedFrame.information_with`).
        converged: whether no neighbour is likelier.
    """

    at: Floats
    deviance: float
    fall: float
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
        tolerance: float = 1e-8,
    ) -> tuple[Floats, Floats]:
        """Least squares of the whitened innovations with fixed gains, within bounds (trust region reflective).

        Starts at (p,) values, and ends when the relative change of the sum of squares is below `tolerance`. Unknowns
        without a prior get one with their scale as deviation, so that those the logs do not determine stay near their
        starts.

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
            max_nfev=self._options.max_evaluations,
        ).x
        return coordinates.values(found), squares(found)[2][:-1, :-1]

    def _square_root(self, normal: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        """(p + 1,) residuals and their Jacobian in coordinates, with the same sum of squares as all innovations."""
        p, largest = len(jacobian), self._options.diverged_sum
        if not np.isfinite(normal).all() or normal[-1, -1] > largest:
            return np.full(p + 1, np.sqrt(largest)), np.zeros((p + 1, p))
        by = np.eye(p + 1)
        by[:p, :p] = jacobian
        eigenvalues, vectors = np.linalg.eigh(by.T @ normal @ by)
        root = np.sqrt(np.maximum(eigenvalues, 0.0))[:, np.newaxis] * vectors.T
        return root[:, -1], root[:, :-1]

    def deviances(self, points: Sequence[Floats], noise: NoiseCovariances, coordinates: SearchCoordinates) -> Floats:
        """Minus twice the logarithm, up to a constant, at each of several points; infinite if filters diverge."""
        machines = [self._machine(coordinates.values(np.clip(point, *coordinates.bounds))) for point in points]
        logs = self._filters.deviances([(machine, noise) for machine in machines]) if machines else np.zeros(0)
        return logs + np.array([coordinates.prior_deviance(point) for point in points])

    def objective(self, points: Sequence[Floats], noise: NoiseCovariances, coordinates: SearchCoordinates) -> Floats:
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
            likelier=bool(min(deviances[1:]) < here - self._rounding(here)),
        )

    def maximum(
        self,
        at: Floats,
        noise: NoiseCovariances,
        coordinates: SearchCoordinates,
        fixed: int | None = None,
        size: float | None = None,
        accuracy: float | None = None,
        progress: progresses.Progress = progresses.no_progress,
    ) -> LikelihoodMaximum | None:
        """The local maximum of the likelihood near (p,) coordinates, for given noise; ``None`` if filters diverge.

        Generating set search with Newton steps (Kolda, Lewis and Torczon, SIAM Review 45 (2003) 385). Where a drum
        turns back or a rope slackens, the likelihood has kinks and jumps, at which slopes lead nowhere; a poll goes on
        from there to whatever neighbour is likelier.

        1. Poll the neighbours (`poll`), first `size` standard deviations away (default: `SearchOptions.reach`) and then
           one, which gives the curvatures.
        2. Move to the likeliest point. After a Newton step the next poll is as wide as that was long, or its square
           where that is shorter, as its error is; after a move to a neighbour it is twice as wide, up to one deviation,
           and half as wide where there was no move.
        3. End where no neighbour at a distance of `accuracy` (default: `SearchOptions.accuracy`) is likelier, or after
           `SearchOptions.max_polls`; for another accuracy after `SearchOptions.max_steps`.
        """
        options, frame = self._options, self.frame(at, noise, coordinates, fixed)
        if frame is None:
            return None
        end = accuracy or options.accuracy
        start = here = float(self.objective([at], noise, coordinates)[0])
        curvatures, size, moved, converged = np.ones(len(at)), size or options.reach, 0.0, False
        for number in range(options.max_polls if accuracy is None else options.max_steps):
            progress(number / (number + 2))
            result = self.poll(frame, at, here, size, noise, coordinates)
            if size == 1:
                curvatures = np.where(np.isnan(result.curvatures), curvatures, result.curvatures)
            if converged := size == end and not result.likelier and moved <= 1:
                break
            fell = here - result.deviance > self._rounding(here)
            at, here, moved = result.at, result.deviance, moved + fell * result.length
            if moved > 1:
                size, moved, frame = 1.0, 0.0, self.frame(at, noise, coordinates, fixed) or frame
            elif number == 0 and size > 1:
                size = 1.0
            elif fell and result.newton:
                size = max(result.length * min(result.length, 1.0), end)
            else:
                size = min(2 * size, 1.0) if fell else max(size / 2, end)
        (deviance,) = self.deviances([at], noise, coordinates).tolist()
        return LikelihoodMaximum(at, deviance, start - here, frame.information_with(curvatures), converged)

    def _rounding(self, deviance: float) -> float:
        """Rounding error of a deviance at most, as a sum over all samples."""
        samples = sum(len(section.readings) for section in self._filters.sections)
        return samples * float(np.finfo(float).eps) * abs(deviance)


def _positive_part(information: Floats) -> Floats:
    """A symmetric matrix with its negative eigenvalues set to zero."""
    eigenvalues, vectors = np.linalg.eigh(information)
    return (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
