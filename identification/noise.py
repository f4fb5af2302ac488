"""Noise covariances of the filter: R by expectation maximisation, Q by maximum likelihood."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from dualwinch.codegen.drivers.prediction import FilterPass
from dualwinch.identification.filter import LogFilters, all_completed
from dualwinch.identification.options import NoiseOptions
from dualwinch.identification.predictor import READINGS, VORTICES, NoiseCovariances, described_disturbances
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.sensors import Sensors

Floats = NDArray[np.float64]

NORMAL_MEDIAN = 0.6745
"""Median of a standard normal variable's magnitude."""

LOAD_CELLS = ("F1", "F2")
"""Sensors that are quiet only where torques are."""

ESTIMATED = (("force",), ("torque_1", "torque_2"))
"""Disturbances that no experiment describes, whose deviations are estimated; those of a group have one."""

DESCRIBED = ("current", "normal_force_variation")
"""Disturbances that an experiment describes; deviations and correlation times are estimated with priors around that."""

SIZE, TIME, TIME_ALONE = np.array([1.0, 0.0]), np.array([0.5, 1.0]), np.array([0.0, 1.0])
"""Changes of the logarithms of deviation and correlation time that are searched: of the size, of the time with the
variance that a sample adds as it is, which a log shows best, and of the time of what has its size."""


def finest_noise(options: NoiseOptions) -> Floats:
    """Least standard deviations of the sensors' noise, (readings,): no sensor is perfect, nor is the model."""
    finest = {
        "x": options.finest_position,
        "v": options.finest_speed,
        "F1": options.finest_tension,
        "F2": options.finest_tension,
        "theta_1": options.finest_angle,
        "theta_2": options.finest_angle,
        "omega_1": options.finest_drum_speed,
        "omega_2": options.finest_drum_speed,
    }
    return np.array([finest[name] for name in READINGS])


def initial_measurement_noise(readings: Floats, sensors: Sensors, options: NoiseOptions) -> Floats:
    """Variances of all sensors to begin with, (readings,).

    As the experiment describes them, quantisation included; for sensors that it describes as perfect, by the log's own
    differences from sample to sample.
    """
    described = {
        "x": math.hypot(sensors.position_noise, sensors.position_resolution / math.sqrt(12)),
        "v": sensors.speed_noise,
        "F1": sensors.tension_noise,
        "F2": sensors.tension_noise,
    }
    deviations = noise_by_differences(readings, options)
    for index, (name, finest) in enumerate(zip(READINGS, finest_noise(options).tolist(), strict=True)):
        if described.get(name, 0.0) > 0:
            deviations[index] = max(described[name], finest)
    return deviations**2


def noise_by_differences(readings: Floats, options: NoiseOptions) -> Floats:
    """Standard deviations of all sensors, (readings,), by third differences, which cancel most of a motion."""
    own = [
        _white_noise(values[np.isfinite(values)], options, options.quiet_share if name in LOAD_CELLS else 1.0)
        for name, values in zip(READINGS, readings.T, strict=True)
    ]
    return np.maximum(own, finest_noise(options))


def _white_noise(values: Floats, options: NoiseOptions, quiet: float) -> float:
    """Standard deviation of white noise, by third differences; of a sensor that counts at least that of rounding."""
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


def _minimum(cost: Callable[[float], float], low: float, high: float, tolerance: float, evaluations: int) -> float:
    """Where a cost is least between two ends, by Brent's method."""
    options = {"xatol": tolerance, "maxiter": evaluations}
    best: Any = minimize_scalar(cost, bounds=(low, high), method="bounded", options=options)
    return float(best.x)


class NoiseEstimator:
    """Estimates R and Q for a machine that is known well enough."""

    def __init__(self, filters: LogFilters, experiment: Experiment, options: NoiseOptions) -> None:
        """An estimator whose least deviations are the ones that an experiment describes."""
        self._filters, self._options = filters, options
        self._described = described_disturbances(experiment, options)
        self._least = {name: each.deviation for name, each in self._described.items()}
        self._samples = round(options.section_time / experiment.simulation.sample_time)

    def tolerable(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """The least process noise of a grid with which no filter diverges; as given where there is none."""
        wider = sorted(self._grid(noise), key=lambda each: each.process["torque_1"].deviation)
        return next((each for each in wider if all_completed(self._filter(experiment, each, None))), noise)

    def with_process_noise(
        self, experiment: Experiment, noise: NoiseCovariances, *, anywhere: bool = False, roughly: bool = False
    ) -> NoiseCovariances:
        """Estimate Q of the disturbances that no experiment describes, by maximum likelihood.

        Args:
            experiment: the machine.
            noise: R, and Q to begin with.
            anywhere: whether a grid over the whole range is searched first.
            roughly: whether the beginning of each section is enough.
        """
        samples = self._samples if roughly else None
        if anywhere:
            noise = min(self._grid(noise), key=lambda each: self._cost(experiment, each, samples))
        for names in ESTIMATED:
            noise = self._line_search(experiment, noise, names, samples)
        return noise

    def with_torque_noise(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """Estimate Q of the further torques alone, roughly, over its whole range.

        What a machine is not known well enough for yet must not become a further force.
        """
        torques = ESTIMATED[1]
        grid = [self._scaled(noise, torques, factor) for factor in self._factors]
        best = min(grid, key=lambda each: self._cost(experiment, each, self._samples))
        return self._line_search(experiment, best, torques, self._samples)

    def with_sea(self, experiment: Experiment, noise: NoiseCovariances) -> NoiseCovariances:
        """Estimate size and correlation time of the disturbances that an experiment describes, by maximum likelihood.

        Their priors are log-normal around what is described.
        """
        options = self._options
        reach = math.log(options.described_reach)
        searches = [
            search
            for name in DESCRIBED
            for search in (
                (name, SIZE, options.described_factor, reach),
                (name, TIME, options.described_time_factor, reach),
            )
        ]
        searches.append((VORTICES, TIME_ALONE, options.vortex_time_factor, 3 * math.log(options.vortex_time_factor)))
        for name, way, factor, reach in searches:
            if factor == 1 or noise.process[name].deviation == 0:
                continue

            def moved(by: float, name: str = name, way: Floats = way, noise: Any = noise) -> NoiseCovariances:
                process = noise.process[name].scaled(*np.exp(by * way).tolist())
                return replace(noise, process={**noise.process, name: process})

            def cost(by: float, moved: Callable[[float], NoiseCovariances] = moved) -> float:
                return self._cost(experiment, moved(by), None) + self._unlikelihood(experiment, moved(by))

            best = _minimum(cost, -reach, reach, options.described_tolerance, options.described_evaluations)
            noise = moved(best)
        return noise

    def _unlikelihood(self, experiment: Experiment, noise: NoiseCovariances) -> float:
        """Negative logarithm of the prior density of the described disturbances, but for a constant."""
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
        """Of a deviation over its least one, over its whole range."""
        options = self._options
        return (options.grid ** np.arange(np.ceil(np.log(options.range) / np.log(options.grid)))).tolist()

    def _grid(self, noise: NoiseCovariances) -> list[NoiseCovariances]:
        """Deviations of all groups on a grid over their range."""
        return [
            reduce(lambda found, pair: self._scaled(found, *pair), zip(ESTIMATED, chosen, strict=True), noise)
            for chosen in product(self._factors, repeat=len(ESTIMATED))
        ]

    def _line_search(
        self, experiment: Experiment, noise: NoiseCovariances, names: Sequence[str], samples: int | None
    ) -> NoiseCovariances:
        """The likeliest deviation of one group near where it is."""
        options, here = self._options, np.log(noise.process[names[0]].deviation / self._least[names[0]])
        reach = np.log(options.grid)
        best = _minimum(
            lambda factor: self._cost(experiment, self._scaled(noise, names, np.exp(factor)), samples),
            max(here - reach, 0.0),
            min(here + reach, np.log(options.range)),
            options.line_tolerance,
            options.line_evaluations,
        )
        return self._scaled(noise, names, np.exp(best))

    def _scaled(self, noise: NoiseCovariances, names: Sequence[str], factor: float) -> NoiseCovariances:
        """With a group's deviation so many times its least one."""
        deviation = float(factor) * self._least[names[0]]
        scaled = {name: replace(noise.process[name], deviation=deviation) for name in names}
        return replace(noise, process={**noise.process, **scaled})

    def _cost(self, experiment: Experiment, noise: NoiseCovariances, samples: int | None) -> float:
        filtered = self._filter(experiment, noise, samples)
        if not all_completed(filtered):
            return self._options.diverged
        return sum(each.negative_log_likelihood for each in filtered)

    def with_measurement_noise(
        self, experiment: Experiment, noise: NoiseCovariances, filtered: Sequence[FilterPass]
    ) -> NoiseCovariances:
        """Estimate R by expectation maximisation, beginning with passes through the sections with this noise."""
        noise, changed = self._em_step(noise, filtered)
        for _ in range(self._options.em_steps):
            if changed < self._options.em_tolerance:
                break
            noise, changed = self._em_step(noise, self._filter(experiment, noise, self._samples))
        return noise

    def _em_step(self, noise: NoiseCovariances, filtered: Sequence[FilterPass]) -> tuple[NoiseCovariances, float]:
        """One step of expectation maximisation, and the largest change of a variance's logarithm."""
        counts = np.sum([each.counts for each in filtered], axis=0)
        squares = np.sum([np.nan_to_num(each.noise * each.counts) for each in filtered], axis=0)
        before, factor = noise.measurement, self._options.em_factor
        variances = np.where(counts > 0, squares / np.maximum(counts, 1), before)
        variances = np.maximum(np.clip(variances, before / factor, before * factor), finest_noise(self._options) ** 2)
        return replace(noise, measurement=variances), float(np.max(np.abs(np.log(variances / before)), initial=0.0))

    def _filter(self, experiment: Experiment, noise: NoiseCovariances, samples: int | None) -> list[FilterPass]:
        return self._filters.run(experiment, noise, gains=False, samples=samples)
