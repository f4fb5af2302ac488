"""Estimate time origin, Strouhal number and amplitude of vortices from smoothed readings, by least squares."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.stats import norm

from dualwinch.toolbox import Experiment, physics
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.options import DEFAULTS, EstimationOptions
from dualwinch.toolboxes.identification.predictor import READINGS
from dualwinch.toolboxes.identification.resample import resampled

Floats = NDArray[np.float64]

REACH = 4
"""Reach of the Gaussian that smooths readings, over its deviation, as usual in SciPy."""


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """Smoothed readings of a log where it moves, (rows,) each.

    Attributes:
        t: time in s.
        x: position in m.
        v, a: speed and acceleration in m/s and m/s².
        net: net force of the ropes in N.
        at_once: whether the machine moves at the first row.
        independent: share of rows whose noise is independent.
    """

    t: Floats
    x: Floats
    v: Floats
    a: Floats
    net: Floats
    at_once: bool
    independent: float

    @property
    def base(self) -> Floats:
        """(rows, 2) regressors of the net force besides drag: acceleration and direction."""
        return np.column_stack([self.a, np.sign(self.v)])

    def first(self, duration: float) -> "SmoothedMotion":
        """Its rows up to a time in s after the first."""
        rows = self.t <= self.t[0] + duration
        series = {name: values[rows] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return replace(self, **series)

    @property
    def one_way(self) -> Floats:
        """(rows, n) 1 in the rows of each of n moves in one direction without a stop, else 0."""
        begins = np.r_[True, (np.diff(np.sign(self.v)) != 0) | (np.diff(self.t) > 1.5 * np.median(np.diff(self.t)))]
        return np.equal.outer(np.cumsum(begins) - 1, np.arange(begins.sum())).astype(float)


def smoothed_motion(log: Log, experiment: Experiment, options: EstimationOptions = DEFAULTS) -> SmoothedMotion | None:
    """Position and net force smoothed by a Gaussian, position differentiated twice; ``None``: too little motion.

    Without a position the mean of the drums is used, without load cells the pulls by the torques: inertia and friction
    of the drums, the difference, are proportional to acceleration and direction, too.
    """
    step, sides = experiment.simulation.sample_time, experiment.plant.sides
    inputs, readings = resampled(log, experiment, options.resampling)
    width = options.vortices.smoothing / step

    def series(name: str) -> Floats:
        values = readings[:, READINGS.index(name)]
        indices = np.flatnonzero(np.isfinite(values))
        return np.interp(np.arange(len(values)), indices, values[indices])

    if "x" in log.readings:
        x = series("x")
    else:
        drums = [side for side in sides if f"theta_{side.number}" in log.readings]
        ways = [side.direction * side.winch.drum_radius * series(f"theta_{side.number}") for side in drums]
        x = np.asarray(np.mean(ways, axis=0), float)
    if {"F1", "F2"} <= set(log.readings):
        net = series("F1") - series("F2")
    else:
        pulls = [side.direction * side.winch.gear_ratio / side.winch.drum_radius for side in sides]
        net = inputs[:, 1:3] @ pulls
    half = math.ceil(REACH * width)
    if len(inputs) <= 2 * half:
        return None
    rows = slice(half, len(inputs) - half, max(1, int(width / 2)))
    impulse = np.eye(1, 2 * half + 1, half)[0]

    def smooth(values: Floats, order: int = 0) -> Floats:
        """The Gaussian filter of SciPy at the rows alone, by its impulse response."""
        response = gaussian_filter1d(impulse, width, order=order, radius=half, mode="constant")
        return sliding_window_view(values, 2 * half + 1)[: -1 : rows.step] @ response[::-1] / step**order

    v = smooth(x, 1)
    moving = np.abs(v) > options.resampling.standstill_speed
    independent = min((rows.step or 1) / (2 * math.sqrt(math.pi) * width), 1.0)  # rows over the Gaussian's length
    t, x, a, net = inputs[rows, 0], smooth(x), smooth(x, 2), smooth(net)
    motion = SmoothedMotion(t[moving], x[moving], v[moving], a[moving], net[moving], bool(moving[0]), independent)
    coefficients = motion.base.shape[1] + 2  # drag and the amplitude of its vortices besides
    return motion if moving.sum() * independent > coefficients else None


def joined(motions: Sequence[SmoothedMotion]) -> SmoothedMotion:
    """Motions concatenated."""
    names = ("t", "x", "v", "a", "net")
    t, x, v, a, net = (np.concatenate([getattr(each, name) for each in motions]) for name in names)
    return SmoothedMotion(t, x, v, a, net, motions[0].at_once, motions[0].independent)


def begins_at_rest(log: Log, experiment: Experiment, options: EstimationOptions = DEFAULTS) -> bool:
    """Whether a log's first speed is not above that of standstill, judged against the noise of its readings.

    The first speed is the slope at the first row of a cubic through the readings of the position, or of a drum, of the
    time over which others are smoothed (least squares, with its standard deviation from the residuals).
    """
    radius = {f"theta_{side.number}": side.winch.drum_radius for side in experiment.plant.sides} | {"x": 1.0}
    name = next((each for each in ("x", *radius) if each in log.readings), None)
    if name is None:
        return False
    t, values = log.t - log.t[0], radius[name] * log.columns[name]
    rows = (t < REACH * options.vortices.smoothing) & np.isfinite(values)
    powers = np.vander(t[rows], 4, increasing=True)
    if len(powers) <= powers.shape[1]:
        return False
    slopes, square = _least_squares(powers, values[rows])
    variance = square / (len(powers) - powers.shape[1]) * np.linalg.inv(powers.T @ powers)[1, 1]
    return abs(slopes[1]) <= options.resampling.standstill_speed + norm.ppf(options.diagnostics.confidence) * math.sqrt(
        variance
    )


def with_vortex_origin(log: Log, experiment: Experiment, options: EstimationOptions = DEFAULTS) -> Log:
    """A log with its time counted from the origin of its vortices' phase, if it begins in motion and shows them.

    The phase is proportional to the time since the run began (paper Section 4.3), which a log cut from it lacks.

    1. Regress the net force of the ropes on acceleration, direction, and drag with vortices (`smoothed_motion`), for
       each Strouhal number and origin of a grid (separable least squares).
    2. Choose the likeliest number with the described one as a prior: in a short log, number and origin can compensate
       each other.
    3. Use its best origin if that is clearly likelier than the log's first row, and likelier than integrated phases,
       which need no origin.
    """
    search, resampling = options.vortices, options.resampling
    if experiment.disturbance.integrated_phase:
        return log
    parts = log.between_gaps(resampling.max_gap, resampling.min_rows)
    motions = [each for part in parts if (each := smoothed_motion(part, experiment, options))]
    if not motions or not motions[0].at_once or begins_at_rest(parts[0], experiment, options):
        return log
    motion = joined(motions).first(search.max_time_before)
    v, t = motion.v, motion.t - log.t[0]
    q, _ = np.linalg.qr(motion.base)
    net = motion.net - q @ (q.T @ motion.net)
    top_speed, disturbance = float(np.max(np.abs(v))), experiment.disturbance
    deviances, at_first_row, origins = list[float](), list[float](), list[float]()
    reach, count = options.search.reach * options.search.strouhal_share, motion.independent * len(net)
    shares = np.linspace(1 - reach, 1 + reach, search.strouhal_points)
    for share in shares.tolist():
        # phase per speed and time
        turn = float(
            physics.vortex_frequency(
                1.0, replace(disturbance, strouhal=share * disturbance.strouhal), experiment.plant.vehicle
            )
        )
        before = np.arange(0.0, search.max_time_before, search.phase_step / (turn * top_speed))
        drag = v * np.abs(v) * (1 - disturbance.vortex_amplitude * np.sin(turn * v * (t + before[:, np.newaxis])))
        drag = drag - (drag @ q) @ q.T
        squares = net @ net - (drag @ net) ** 2 / np.einsum("ij,ij->i", drag, drag)
        best, prior = int(np.argmin(squares)), ((share - 1) / options.search.strouhal_share) ** 2
        both = _deviances(squares[[best, 0]], count, 1 + len(q.T)) + prior
        deviances.append(float(both[0]))
        at_first_row.append(float(both[1]))
        origins.append(float(before[best]))
    index = int(np.argmin(deviances))
    if not min(at_first_row) - deviances[index] >= options.search.considerable:  # or too few rows
        return log
    integrated = _regression([motion], experiment, reach * disturbance.strouhal, options, integrated=True)
    if integrated.deviance < deviances[index]:
        return log
    origin = origins[index]
    note = f"{log.name}: begins under way; its vortices are those of a run that began {origin:.3g} s before"
    return replace(log, t=log.t + origin, notes=(*log.notes, note))


@dataclass(frozen=True, eq=False)
class VortexRegression:
    """Regression of the ropes' net force in logs on the resistance of the vehicle, including vortices.

    Regressors are acceleration, direction, drag, and drag times the sine of the vortices' phase, for each Strouhal
    number of a grid around the described one. An integrated phase is unknown at the beginning of each move in one
    direction: then there are the sine and the cosine, with separate coefficients for each move.

    Attributes:
        integrated: whether the phase is integrated.
        numbers: (n,) Strouhal numbers.
        priors: (n,) squared distances from the described one, in prior deviations.
        largest_phase: largest phase in rad, over the Strouhal number.
        squares: (n,) residual sum of squares with each.
        ratios: (n,) amplitudes of the vortices, over the drag.
        described: residual sum of squares with the described Strouhal number, or without vortices if none are
            described.
        rows: number of independent rows of the regression.
        coefficients: their number.
    """

    integrated: bool
    numbers: Floats
    priors: Floats
    largest_phase: float
    squares: Floats
    ratios: Floats
    described: float
    rows: float
    coefficients: int

    @property
    def deviance(self) -> float:
        """Deviance of the best number with its prior, without the fall that the coefficients cause by chance.

        NaN, which is neither likelier nor less likely than any other, if there are too few rows.
        """
        return float(np.min(_deviances(self.squares, self.rows, self.coefficients) + self.priors))


def _deviances(squares: Floats, rows: float, coefficients: int) -> Floats:
    """Deviances of residuals of independent rows, with the unbiased estimates of their variances; NaN: too few rows."""
    return rows * np.log(squares / (rows - coefficients)) if rows > coefficients else np.full_like(squares, np.nan)


def vortex_regression(
    logs: Sequence[Log],
    experiment: Experiment,
    reach: float,
    options: EstimationOptions = DEFAULTS,
    *,
    integrated: bool | None = None,
) -> VortexRegression | None:
    """The regression, within `reach` of the described Strouhal number; ``None`` if the logs can show no vortices.

    The phase is `integrated` or not; default: as the experiment describes.
    """
    motions = [each for log in logs if (each := smoothed_motion(log, experiment, options))]
    if not motions or not experiment.disturbance.strouhal:
        return None
    integrated = experiment.disturbance.integrated_phase if integrated is None else integrated
    return _regression(motions, experiment, reach, options, integrated=integrated)


def _regression(
    motions: Sequence[SmoothedMotion],
    experiment: Experiment,
    reach: float,
    options: EstimationOptions,
    *,
    integrated: bool,
) -> VortexRegression:
    """The regression of `vortex_regression` from smoothed readings."""
    search, disturbance, motion = options.vortices, experiment.disturbance, joined(motions)
    v, net, base, drag = motion.v, motion.net, motion.base, motion.v * np.abs(motion.v)
    per_number = physics.vortex_frequency(1.0, replace(disturbance, strouhal=1.0), experiment.plant.vehicle)
    turn = per_number * (motion.x if integrated else v * motion.t)  # phase by number
    ways = motion.one_way if integrated else np.ones((len(v), 1))

    def vortices(number: float) -> Floats:
        waves = [np.sin(number * turn), *([np.cos(number * turn)] if integrated else [])]
        return np.column_stack([ways * (drag * wave)[:, np.newaxis] for wave in waves])

    largest_phase = float(np.max(np.abs(turn)))
    count = 2 + int(reach * largest_phase / search.phase_step)
    numbers = np.linspace(max(disturbance.strouhal - reach, 0.0), disturbance.strouhal + reach, 2 * count + 1)
    squares, ratios = np.full(len(numbers), np.inf), np.zeros(len(numbers))
    for index, number in enumerate(numbers):
        coefficients, squares[index] = _least_squares(np.column_stack([base, drag, vortices(number)]), net)
        size = (
            np.sqrt(2 * np.mean((vortices(number) @ coefficients[3:] / drag) ** 2)) if integrated else -coefficients[3]
        )
        ratios[index] = size / coefficients[2] if coefficients[2] > 0 else 0.0
    priors = ((numbers / disturbance.strouhal - 1) / options.search.strouhal_share) ** 2
    regressors = [drag]
    if disturbance.vortex and integrated == disturbance.integrated_phase:
        regressors.append(vortices(disturbance.strouhal))
    _, described = _least_squares(np.column_stack([base, *regressors]), net)
    rows, coefficients = motion.independent * len(net), base.shape[1] + 1 + len(ways.T) * (1 + integrated)
    return VortexRegression(integrated, numbers, priors, largest_phase, squares, ratios, described, rows, coefficients)


def _least_squares(rows: Floats, values: Floats) -> tuple[Floats, float]:
    """Coefficients, and the residual sum of squares."""
    coefficients = np.asarray(np.linalg.lstsq(rows, values)[0], float)
    return coefficients, float(np.sum((values - rows @ coefficients) ** 2))


def vortex_starts(
    logs: Sequence[Log], experiment: Experiment, reach: float, options: EstimationOptions = DEFAULTS
) -> list[tuple[float, float]]:
    """Strouhal numbers and amplitudes of vortices at which logs are likely, the likeliest first.

    These are the minima of the residual sum of squares with a positive amplitude, without those that are clearly less
    likely than the least.
    """
    regression = vortex_regression(logs, experiment, reach, options)
    if regression is None:
        return []
    squares, ratios = regression.squares, regression.ratios
    rise = regression.rows * np.log(squares / squares.min())
    lowest = np.r_[False, (squares[1:-1] < squares[:-2]) & (squares[1:-1] <= squares[2:]), False] & (ratios > 0)
    likely = np.flatnonzero(lowest & (rise <= options.search.considerable))
    return [(float(regression.numbers[each]), float(ratios[each])) for each in likely[np.argsort(squares[likely])]]


def likelier_regression(
    logs: Sequence[Log], experiment: Experiment, reach: float, options: EstimationOptions = DEFAULTS
) -> VortexRegression | None:
    """The regression with the described kind of phase, or with the other kind if that is clearly likelier."""
    described = experiment.disturbance.integrated_phase
    regression, other = (
        vortex_regression(logs, experiment, reach, options, integrated=each) for each in (described, not described)
    )
    if regression and other and other.deviance < regression.deviance - options.search.considerable:
        return other
    return regression


def likelier_phase(
    logs: Sequence[Log], experiment: Experiment, reach: float, options: EstimationOptions = DEFAULTS
) -> bool:
    """Whether vortices have an integrated phase (E4) rather than one that follows from speed and time.

    As the experiment describes, unless logs clearly contradict it.
    """
    regression = likelier_regression(logs, experiment, reach, options)
    return regression.integrated if regression else experiment.disturbance.integrated_phase


def shows_other_vortices(
    logs: Sequence[Log], experiment: Experiment, reach: float, options: EstimationOptions = DEFAULTS
) -> bool:
    """Whether vortices that are not described, or of another Strouhal number or kind of phase, fit logs better.

    Another number is one whose phase differs by more than a radian at the end: less is found from the described one.
    """
    disturbance = experiment.disturbance
    regression = likelier_regression(logs, experiment, reach, options)
    if regression is None:
        return False
    fall = regression.rows * float(np.log(regression.described / regression.squares.min()))
    if fall < options.search.considerable:
        return False
    if not disturbance.vortex or regression.integrated != disturbance.integrated_phase:
        return True
    number = float(regression.numbers[np.argmin(regression.squares)])
    return abs(number - disturbance.strouhal) * regression.largest_phase > 1
