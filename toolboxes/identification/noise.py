"""Noise of the filters: covariances R of the sensors and Q of unrecorded disturbances, first guesses and estimates.

Both are estimated along with the parameters (`likelihood.Likelihood`), in coordinates that are logarithms. Before that,
rough guesses are by expectation maximisation for R, and line searches of the likelihood for Q.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import norm

from dualwinch.toolbox import Experiment
from dualwinch.toolboxes.identification.filter import LogFilters, all_completed, deviance_of
from dualwinch.toolboxes.identification.options import NoiseOptions
from dualwinch.toolboxes.identification.prediction import FilterPass
from dualwinch.toolboxes.identification.predictor import (
    READINGS,
    VORTICES,
    GaussMarkov,
    NoiseCovariances,
    described_disturbances,
)

Floats = NDArray[np.float64]

DIVERGED = float(np.finfo(float).max ** 0.5)
"""Half the deviance of a filter that diverges, in a line search."""

LOAD_CELLS = "F1", "F2"
"""Sensors of the ropes' tensions."""

ESTIMATED = (("force",), ("torque_1", "torque_2"))
"""Disturbances that no experiment describes, in groups with a common estimated deviation."""

DESCRIBED = ("current", "normal_force_variation")
"""Disturbances that an experiment describes; deviations and correlation times have priors around the described ones."""

SIZE, TIME, TIME_ALONE = (1.0, 0.0), (0.5, 1.0), (0.0, 1.0)
"""Search directions for the logarithms of deviation and correlation time: the deviation; the time with a constant
variance added per sample, which a log determines best; and the time alone."""


def min_noise(experiment: Experiment, options: NoiseOptions) -> Floats:
    """(readings,) least standard deviations of the sensors' noise, as neither sensors nor model are perfect."""
    length, tension = options.resolution, options.resolution * experiment.controller.limits.tension_max
    turns = {side.number: length / side.winch.drum_radius for side in experiment.plant.sides}
    finest = {"x": length, "v": length} | dict.fromkeys(LOAD_CELLS, tension)
    finest |= {f"{name}_{number}": turn for number, turn in turns.items() for name in ("theta", "omega")}
    return np.array([finest[name] for name in READINGS])


def initial_measurement_noise(readings: Floats, experiment: Experiment, options: NoiseOptions) -> Floats:
    """(readings,) initial variances of all sensors.

    As described by the experiment, quantisation included; for sensors described as perfect, from differences between
    the log's samples.
    """
    sensors = experiment.sensors
    described = {
        "x": sensors.position_deviation,
        "v": sensors.speed_noise,
        "F1": sensors.tension_noise,
        "F2": sensors.tension_noise,
    }
    deviations = noise_by_differences(readings, experiment, options)
    for index, (name, finest) in enumerate(zip(READINGS, min_noise(experiment, options).tolist(), strict=True)):
        if described.get(name, 0.0) > 0:
            deviations[index] = max(described[name], finest)
    return deviations**2


def noise_by_differences(readings: Floats, experiment: Experiment, options: NoiseOptions) -> Floats:
    """(readings,) standard deviations of all sensors' noise, by third differences, which cancel most of a motion."""
    own = [_white_noise(values[np.isfinite(values)]) for values in readings.T]
    return np.maximum(own, min_noise(experiment, options))


def _white_noise(values: Floats) -> float:
    """Standard deviation of white noise by third differences; for a quantised sensor at least that of rounding."""
    if len(values) < 10:
        return 0.0
    steps = np.abs(np.diff(values))
    least = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
    jumps = np.abs(np.diff(values, 3))
    deviation = float(np.median(jumps) / norm.ppf(0.75)) / math.sqrt(20)  # of differences of independent values
    counts = least > 0 and np.allclose(np.rint(steps / least), steps / least, atol=1e-3)
    return max(deviation, least / math.sqrt(12)) if counts else deviation


def _minimum_between(
    cost: Callable[[float], float], ends: tuple[float, float], options: NoiseOptions
) -> tuple[float, float]:
    """Minimise a cost between two ends by Brent's method; returns the minimum and its cost."""
    accuracy = {"xatol": options.tolerance, "maxiter": options.max_evaluations}
    best: Any = minimize_scalar(cost, bounds=ends, method="bounded", options=accuracy)
    return float(best.x), float(best.fun)


def minimum_nearby(
    cost: Callable[[float], float],
    here: tuple[float, float],
    step: float,
    ends: tuple[float, float],
    tolerance: float,
    evaluations: int,
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
        if known[middle] - least < tolerance**2 / 2:
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


@dataclass(frozen=True)
class NoiseCoordinate:
    """A coordinate of the noise: its change is that of the logarithms of some deviations and correlation times.

    Attributes:
        sensor: the sensor whose deviation it is; -1: none.
        disturbances: whose deviation and time they are.
        way: changes of the logarithms of these two.
        lower, upper: bounds.
    """

    sensor: int = -1
    disturbances: tuple[str, ...] = ()
    way: tuple[float, float] = SIZE
    lower: float = -np.inf
    upper: float = np.inf


class NoiseCoordinates:
    """Coordinates of R and Q around some noise, where they are zero: logarithms of deviations and correlation times.

    Described disturbances have log-normal priors around the described values. What no sensor reads, or is described as
    known, has no coordinate.

    Attributes:
        bounds: (m,) each.
        prior_rows, prior_residuals: (n, m) and (n,): rows times the coordinates plus these are standard normal
            variables.
    """

    def __init__(
        self,
        noise: NoiseCovariances,
        least: Mapping[int, float],
        described: Mapping[str, GaussMarkov],
        options: NoiseOptions,
    ) -> None:
        """Coordinates around some noise of sensors, by their indices with least deviations, and of disturbances."""
        self._around = noise
        self._coordinates = [*_of_sensors(noise, least), *_of_disturbances(noise, described, options)]
        rows, residuals = list[list[float]](), list[float]()
        pairs = [(name, *[options.described_factor] * 2) for name in DESCRIBED]
        for name, of_size, of_time in (*pairs, (VORTICES, 1.0, options.vortex_time_factor)):
            own, usual = noise.process[name], described[name]
            values = (own.deviation, usual.deviation, of_size), (own.time, usual.time, of_time)
            for place, (value, expected, factor) in enumerate(values):
                if own.deviation > 0 and factor > 1:
                    ways = [each.way[place] if name in each.disturbances else 0.0 for each in self._coordinates]
                    rows.append([way / math.log(factor) for way in ways])
                    residuals.append(math.log(value / expected) / math.log(factor))
        self.prior_rows = np.array(rows).reshape(len(rows), len(self._coordinates))
        self.prior_residuals = np.array(residuals)
        ends, reach = ("lower", "upper"), -math.log(options.resolution)
        bounds = [[getattr(each, end) for each in self._coordinates] for end in ends]
        self.bounds: tuple[Floats, Floats] = tuple(np.clip(bounds, -reach, reach))

    def __len__(self) -> int:
        """Number of coordinates."""
        return len(self._coordinates)

    def noise(self, coordinates: Floats) -> NoiseCovariances:
        """The noise at (m,) coordinates."""
        measurement, process = self._around.measurement.copy(), dict(self._around.process)
        for each, by in zip(self._coordinates, coordinates.tolist(), strict=True):
            if each.sensor >= 0:
                measurement[each.sensor] *= math.exp(2 * by)
            for name in each.disturbances:
                process[name] = process[name].scaled(*(math.exp(by * way) for way in each.way))
        return replace(self._around, measurement=measurement, process=process)

    def prior_deviance(self, coordinates: Floats) -> float:
        """Minus twice the logarithm of the priors' density, up to a constant."""
        return float(np.sum((self.prior_rows @ coordinates + self.prior_residuals) ** 2))


def _of_sensors(noise: NoiseCovariances, least: Mapping[int, float]) -> Iterator[NoiseCoordinate]:
    """A coordinate for the deviation of each sensor that was read."""
    for sensor, deviation in least.items():
        below = math.log(deviation) - math.log(noise.measurement[sensor]) / 2
        yield NoiseCoordinate(sensor=sensor, lower=min(below, 0.0))


def _of_disturbances(
    noise: NoiseCovariances, described: Mapping[str, GaussMarkov], options: NoiseOptions
) -> Iterator[NoiseCoordinate]:
    """Coordinates for deviations that no experiment describes, and of described disturbances that are uncertain."""
    for names in ESTIMATED:
        above = math.log(noise.process[names[0]].deviation / described[names[0]].deviation)
        lower, upper = min(-above, 0.0), max(-math.log(options.resolution) - above, 0.0)
        yield NoiseCoordinate(disturbances=names, lower=lower, upper=upper)
    uncertain = [
        *((name, SIZE, options.described_factor) for name in DESCRIBED),
        *((name, TIME, options.described_factor) for name in DESCRIBED),
        (VORTICES, TIME_ALONE, options.vortex_time_factor),
    ]
    for name, way, factor in uncertain:
        if noise.process[name].deviation > 0 and factor > 1:
            yield NoiseCoordinate(disturbances=(name,), way=way)


class NoiseEstimator:
    """Estimates R and Q for approximately known parameters."""

    def __init__(self, filters: LogFilters, experiment: Experiment, options: NoiseOptions) -> None:
        """Set up; the least deviations of disturbances are those that the experiment describes."""
        self._filters, self._options = filters, options
        self._described = described_disturbances(experiment, options)
        self._least = {name: each.deviation for name, each in self._described.items()}
        self._samples = round(options.section_time / experiment.simulation.sample_time)
        self._min_noise = min_noise(experiment, options)
        read = np.any([np.isfinite(section.readings).any(axis=0) for section in filters.sections], axis=0)
        self._read = {sensor: float(self._min_noise[sensor]) for sensor in np.flatnonzero(read).tolist()}

    def coordinates(self, noise: NoiseCovariances) -> NoiseCoordinates:
        """Coordinates around some noise."""
        return NoiseCoordinates(noise, self._read, self._described, self._options)

    def tolerable(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """The least process noise of a grid with which no filter diverges; as given if there is none."""
        wider = sorted(self._grid(noise), key=lambda each: each.process["torque_1"].deviation)
        return next((each for each in wider if all_completed(self._filter(experiment, each, None))), noise)

    def with_process_noise(
        self, experiment: Experiment, noise: NoiseCovariances, *, anywhere: bool = False
    ) -> NoiseCovariances:
        """Estimate Q of the disturbances that no experiment describes, roughly, by the beginning of each section.

        The search begins with the given Q or, if `anywhere`, with the best of a grid over the whole range.
        """
        if anywhere:
            noise, here = self._likeliest(experiment, self._grid(noise), self._samples)
        else:
            here = self._cost(experiment, noise, self._samples)
        for names in ESTIMATED:
            noise, here = self._line_search(experiment, noise, names, here)
        return noise

    def with_torque_noise(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """Estimate Q of the unrecorded torques only, roughly, over its whole range.

        Errors of parameters that are not yet estimated well must not be attributed to an unrecorded force.
        """
        torques = ESTIMATED[1]
        grid = [self._scaled(noise, torques, factor) for factor in self._factors]
        best, cost = self._likeliest(experiment, grid, self._samples)
        return self._line_search(experiment, best, torques, cost)[0]

    def with_sea(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """Estimate deviation and correlation time of described disturbances, by maximum likelihood.

        Their priors are log-normal around the described values; searches go up to two of their deviations.
        """
        options = self._options
        searches = [(name, way, options.described_factor) for name in DESCRIBED for way in (SIZE, TIME)]
        for name, way, factor in (*searches, (VORTICES, TIME_ALONE, options.vortex_time_factor)):
            if factor == 1 or noise.process[name].deviation == 0:
                continue
            reach = 2 * math.log(factor)  # two deviations of the prior

            def moved(by: float, name: str = name, way: Any = way, noise: Any = noise) -> NoiseCovariances:
                process = noise.process[name].scaled(*(math.exp(by * each) for each in way))
                return replace(noise, process={**noise.process, name: process})

            def cost(by: float, moved: Callable[[float], NoiseCovariances] = moved) -> float:
                there = moved(by)
                priors = self.coordinates(there)
                return self._cost(experiment, there, None) + priors.prior_deviance(np.zeros(len(priors))) / 2

            noise = moved(_minimum_between(cost, (-reach, reach), options)[0])
        return noise

    @property
    def _factors(self) -> list[float]:
        """Grid of factors on the least deviation, over its whole range."""
        options = self._options
        return (options.grid ** np.arange(np.ceil(-np.log(options.resolution) / np.log(options.grid)))).tolist()

    def _grid(self, noise: NoiseCovariances) -> list[NoiseCovariances]:
        """Deviations of all groups on a grid over their range."""
        return [
            reduce(lambda found, pair: self._scaled(found, *pair), zip(ESTIMATED, chosen, strict=True), noise)
            for chosen in product(self._factors, repeat=len(ESTIMATED))
        ]

    def _line_search(
        self, experiment: Experiment, noise: NoiseCovariances, names: Sequence[str], here: float
    ) -> tuple[NoiseCovariances, float]:
        """The likeliest deviation of one group near the present one, whose cost is `here`; and the cost with it."""
        options, now = self._options, np.log(noise.process[names[0]].deviation / self._least[names[0]])
        reach = np.log(options.grid)
        ends = float(max(now - reach, 0.0)), float(min(now + reach, -np.log(options.resolution)))

        def cost_of(factor: float) -> float:
            return self._cost(experiment, self._scaled(noise, names, np.exp(factor)), self._samples)

        if options.whole_range:
            best, cost = _minimum_between(cost_of, ends, options)
        else:
            start = float(now), here
            best, cost = minimum_nearby(cost_of, start, reach / 4, ends, options.tolerance, options.max_evaluations)
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
        return noises[best], min(float(deviances[best]) / 2, DIVERGED)

    def _cost(self, experiment: Experiment, noise: NoiseCovariances, samples: int | None) -> float:
        filtered = self._filter(experiment, noise, samples)
        if not all_completed(filtered):
            return DIVERGED
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
        least, largest = 2 * np.log(self._min_noise), np.log(np.finfo(float).max) / 2
        for _ in range(self._options.max_evaluations):
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
            if before - cost < self._options.tolerance**2 / 2:
                break
        return noise

    def _em_step(self, noise: NoiseCovariances, filtered: Sequence[FilterPass]) -> NoiseCovariances:
        """One step of expectation maximisation for R."""
        counts = np.sum([each.counts for each in filtered], axis=0)
        squares = np.sum([np.nan_to_num(each.noise * each.counts) for each in filtered], axis=0)
        variances = np.where(counts > 0, squares / np.maximum(counts, 1), noise.measurement)
        return replace(noise, measurement=np.maximum(variances, self._min_noise**2))

    def _filter(self, experiment: Experiment, noise: NoiseCovariances, samples: int | None) -> list[FilterPass]:
        return self._filters.run(experiment, noise, gains=False, samples=samples)
