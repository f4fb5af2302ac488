"""Experiment design: search for the motion with the most informative log, by CMA-ES.

Candidates move from rest to rest through way-points, within limits of track, speed, acceleration, tension and torque.
The information of each simulated log gives the covariance of the estimates; CMA-ES searches for the best candidate.
D-optimal motions have the smallest joint confidence region, A-optimal ones the smallest mean variance, each parameter
over its prior deviation (Pukelsheim, Optimal Design of Experiments; Goodwin and Payne, Dynamic System Identification:
Experiment Design and Data Analysis).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq

from dualwinch.toolbox import (
    ConfigurationError,
    Ensemble,
    Experiment,
    Result,
    arguments,
    drawing,
    executors,
    motions,
    preparation,
    progresses,
    quantities,
    references,
    runs,
    tables,
)
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.log import log_of
from dualwinch.toolboxes.identification.options import DEFAULTS, EstimationOptions, ExcitationOptions
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import (
    Prior,
    UncertainEstimates,
    UnknownParameter,
    covariance_of,
    problem_of,
    unknown_parameters,
)

Floats = NDArray[np.float64]
Criterion = Literal["D", "A"]

Cost = tuple[float, float]
"""Largest violation of a limit, minus infinity for none, and criterion: the lower, the better, in this order."""

LARGEST_SEED = int(np.iinfo(np.uint32).max)
"""Largest seed of the search."""


@dataclass(frozen=True)
class MotionLimits(motions.MoveLimits):
    """Limits of a run: those of its moves, farthest position in m, largest tension in N and motor torque in N m."""

    farthest: float
    tension: float
    torque: float = math.inf


def motion_limits(
    experiment: Experiment,
    *,
    track: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    torque: float | None = None,
    options: ExcitationOptions = DEFAULTS.excitation,
) -> MotionLimits:
    """The limits of an experiment, possibly tightened; arguments as in `excite`.

    Raises:
        ConfigurationError: a limit out of range.
    """
    length, limits = experiment.plant.track.length, experiment.controller.limits
    if track is not None and not 0 < track <= length:
        raise ConfigurationError(f"track = {track:g}: must be > 0 and <= plant.track.length = {length:g} m")
    bounds = {"speed": speed, "acceleration": acceleration, "torque": torque}
    for name, value in bounds.items():
        if value is not None and not 0 < value < math.inf:
            raise ConfigurationError(f"{name} = {value:g}: must be > 0")
    largest = acceleration or options.force_share * float(limits.force) / experiment.plant.vehicle.mass
    return MotionLimits(
        farthest=track or max(length - 1.0, length / 2),
        speed=speed or references.cruise_speed(experiment.reference),
        acceleration=largest,
        jerk=experiment.reference.jerk_limit or largest / options.jerk_time,
        tension=limits.tension_max,
        torque=torque or math.inf,
    )


def motion_dimensions(duration: float, options: ExcitationOptions = DEFAULTS.excitation) -> int:
    """Number of coordinates of a motion of a given duration in s: two, plus two per move."""
    return 2 + 2 * min(max(int(duration // options.time_per_move), 2), options.max_moves)  # at least there and back


def motion_of(
    shares: Floats, limits: MotionLimits, duration: float, options: ExcitationOptions = DEFAULTS.excitation
) -> references.Reference | None:
    """The motion of a duration in s with given coordinates, in round numbers; ``None`` if nothing moves.

    Coordinates are (dimensions,) shares between 0 and 1: speed and acceleration, then target and time of every move.
    Each move goes as far towards its target as its time permits, and rests for the remainder: so every motion ends in
    time, and depends continuously on its coordinates.
    """
    speed, acceleration = (
        min(float(f"{options.min_speed_share ** (1 - share) * largest:.2g}"), largest)
        for share, largest in zip(shares[:2], (limits.speed, limits.acceleration), strict=True)
    )
    move_limits = motions.MoveLimits(speed, acceleration, limits.jerk and float(f"{limits.jerk:.2g}"))
    targets, weights = shares[2::2] * limits.farthest, shares[3::2] ** 2 + 1e-6
    points, pauses, position, budget = list[float](), list[float](), 0.0, 0.0
    for target, time in zip(targets, np.diff(duration * np.cumsum(weights) / weights.sum(), prepend=0.0), strict=True):
        budget += time
        way = _floor(min(abs(target - position), _farthest(budget, move_limits)))
        if not way:
            continue
        position = round(position + float(np.copysign(way, target - position)), 2)
        points.append(position)
        pauses.append(max(_floor(budget - _move_time(way, move_limits)) - 0.01, 0.0))
        budget -= _move_time(way, move_limits) + pauses[-1]
    if not points:
        return None
    return references.Reference(
        kind="way-points",
        speed=speed,
        acceleration=acceleration,
        jerk_limit=move_limits.jerk,
        points=tuple(points),
        pauses=tuple(round(pause, 2) for pause in pauses),
    )


def _move_time(way: float, limits: motions.MoveLimits) -> float:
    """Time in s from rest to rest over a distance in m."""
    speed = motions.top_speed(way, limits)
    return motions.gaining_time(speed, limits) + way / speed


def _farthest(time: float, limits: motions.MoveLimits) -> float:
    """The largest distance in m in a time in s."""
    shortest, bound = 0.01, limits.speed * time
    if bound <= shortest or _move_time(shortest, limits) >= time:
        return 0.0
    longest: Any = brentq(lambda way: _move_time(way, limits) - time, shortest, bound)
    return float(longest)


def _floor(value: float) -> float:
    """A number rounded down to two decimals."""
    return float(np.floor(100 * value) / 100)


class ExpectedCovariance(NamedTuple):
    """The expected (p, p) covariance of a run's estimates, priors included; ``None`` if the run violates a limit.

    Then `violation` is the largest violation, as a share of the limit, and `words` describe it.
    """

    covariance: Floats | None
    violation: float = 0.0
    words: str = ""


def with_motion(experiment: Experiment, reference: references.Reference, duration: float) -> Experiment:
    """An experiment with another motion, and with sensor readings in its rows."""
    simulation = replace(experiment.simulation, duration=duration, readings=True)
    return replace(experiment, reference=reference, simulation=simulation)


def expected_covariance(
    experiment: Experiment,
    unknowns: Sequence[UnknownParameter],
    limits: MotionLimits | None,
    options: EstimationOptions = DEFAULTS,
) -> ExpectedCovariance:
    """The expected covariance of estimates from a run, by the information of its simulated log within given limits."""
    run = runs.simulate(experiment)
    if run.outcome != "completed":
        return ExpectedCovariance(None, 1.0, f"the run {run.outcome.replace('_', ' ')}")
    violation, words = _violation(run, limits, options.excitation) if limits else (0.0, "")
    if violation > 0:
        return ExpectedCovariance(None, violation, words)
    sections = sections_of([log_of(run)], experiment, options.resampling)
    method = PredictionErrorMethod(sections, experiment, unknowns, options, threads=1)
    information = method.information(np.array([unknown.start for unknown in unknowns]))
    if information is None:
        return ExpectedCovariance(None, 1.0, "a filter that diverges")
    return ExpectedCovariance(covariance_of(information, unknowns))


def _violation(run: Result, limits: MotionLimits, options: ExcitationOptions) -> tuple[float, str]:
    """The largest violation of a limit in a run, as a share of it (<= 0: none), and in words."""
    peak, slack = float(run.metrics.peak_tension), float(run.metrics.slack_share)
    torque = max(float(np.abs(run[name]).max()) for name in ("tau_1", "tau_2"))
    speed, fastest = float(np.abs(run["v"]).max()), (1 + options.max_overshoot) * limits.speed
    largest_slack = options.max_slack_share
    violations = [
        (peak / limits.tension - 1, f"a rope's tension of {peak:.4g} N: must be <= {limits.tension:g} N"),
        (torque / limits.torque - 1, f"a motor's torque of {torque:.4g} N m: must be <= {limits.torque:g} N m"),
        (speed / fastest - 1, f"a speed of {speed:.3g} m/s: must be <= {fastest:.3g} m/s"),
        (slack - largest_slack, f"a rope without tension for {slack:.2%} of the run: must be <= {largest_slack:.1%}"),
    ]
    return max(violations, key=lambda each: each[0])


@dataclass(frozen=True, eq=False, repr=False)
class ExcitationDesign(UncertainEstimates):
    """A motion designed to determine parameters.

    Attributes:
        experiment: with the motion as its reference, and with sensor readings in its rows.
        unknowns, covariance: the parameters to estimate, and expected (p, p) covariance of the estimates' errors.
        present: expected (p, p) covariance with the experiment's own motion; ``None`` if its run does not complete.
        criterion: ``D`` or ``A``.
        duration: of the run in s.
        tried: number of simulated motions.
        seed: of the search.
        seconds: wall time.
        interrupted: whether an interrupt ended the search; then this is the best motion up to there.
    """

    experiment: Experiment
    present: Floats | None
    criterion: str
    duration: float
    tried: int
    seed: int
    seconds: float
    interrupted: bool = False

    @property
    def present_deviations(self) -> Floats:
        """(p,) expected standard deviations with the experiment's own motion; NaN if its run does not complete."""
        return np.full(len(self.keys), np.nan) if self.present is None else np.sqrt(np.diag(self.present))

    @property
    def headline(self) -> str:
        """The search in a line."""
        return f"the best of {self.tried} motions of {self.duration:g} s, {self.criterion}-criterion, seed {self.seed}"

    @property
    def motion(self) -> str:
        """The motion in a line."""
        reference = self.experiment.reference
        points = ", ".join(f"{point:g}" for point in reference.points)
        return f"way-points {points} m at up to {reference.speed:g} m/s and {reference.acceleration:g} m/s^2"

    @property
    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows: expected standard deviations with the present motion, and with this one."""
        rows = []
        for unknown, before, after in zip(self.unknowns, self.present_deviations, self.deviations, strict=True):
            is_finite = np.isfinite(before)
            rows.append([
                unknown.key,
                f"{unknown.start:.6g}",
                f"{before:.2g}" if is_finite else "",
                f"{after:.2g}",
                tables.relative(after, unknown.start),
                f"{before / after:.3g}" if is_finite else "",
                quantities.behind_number(unknown.unit).strip(),
            ])  # fmt: skip
        deviations = ["std. deviation, present motion", "this motion"]
        return ["parameter", "start", *deviations, "relative", "ratio", "unit"], rows

    def to_record(self) -> dict[str, Any]:
        """All results as a dictionary for JSON; standard deviations in the unit of their parameter."""
        reference = self.experiment.reference
        return {
            "criterion": self.criterion,
            "duration": self.duration,
            "tried": self.tried,
            "seed": self.seed,
            "seconds": self.seconds,
            "parameters": [
                {
                    "key": unknown.key,
                    "unit": unknown.unit,
                    "start": unknown.start,
                    "present_deviation": float(before),
                    "deviation": float(after),
                    "relative_deviation": float(after / abs(unknown.start)) if unknown.start else None,
                    "times_smaller": float(before / after),
                }
                for unknown, before, after in zip(self.unknowns, self.present_deviations, self.deviations, strict=True)
            ],
            "motion": {
                "points": list(reference.points),
                "speed": reference.speed,
                "acceleration": reference.acceleration,
            },
            "units": {"duration": "s", "seconds": "s", "points": "m", "speed": "m/s", "acceleration": "m/s^2"},
        }

    def __repr__(self) -> str:
        return "\n".join([f"Excited: {self.headline}", "", tables.markdown(*self.table), "", self.motion])

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
        return tables.page("Excited", f"{self.headline}. {self.motion}", tables.table(*self.table))

    def plot(self, *, ax: drawing.GivenAxes = None) -> Figure:
        """Draw the motion, and its expected deviations beside the present motion's, into two axes or a new figure."""
        rows = range(len(self.unknowns))
        with drawing.new_page(ax, 2.2 + 0.2 * max(len(rows), 4), "An informative run", self.headline) as page:
            left, right = page.panels(1, 2)
            t = np.linspace(0, self.duration, 600)
            left.plot(t, references.setpoint(t, self.experiment.reference).x, color=drawing.BLUE)
            left.set(xlabel="time (s)", ylabel="reference (m)", xlim=(0, self.duration))
            by = np.array([unknown.uncertainty for unknown in self.unknowns]) / 100
            before, after = self.present_deviations / by, self.deviations / by
            right.hlines(rows, before, after, color=drawing.GREY, linewidth=1.0)
            right.plot(
                before, rows, "o", color="white", markeredgecolor=drawing.GREY, markersize=5, label="present motion"
            )
            right.plot(after, rows, "o", color=drawing.BLUE, markersize=5, label="this motion")
            right.set_yticks(
                rows, [drawing.plain(key.removeprefix("plant.").removeprefix("sensors.")) for key in self.keys]
            )
            right.set_ylim(len(rows) - 0.5, -0.5)
            drawing.logarithmic(right, between=(1, 2, 5))
            right.set_xlabel("deviation to expect, % of the parameter")
            page.legend()
        return page.figure


def excite(
    keys: str | Sequence[str],
    experiment: Experiment | None = None,
    *,
    duration: float = 60.0,
    ensemble: str | PathLike[str] | Ensemble | None = None,
    priors: Mapping[str, Prior | tuple[float, float]] | None = None,
    criterion: Criterion = "D",
    track: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    torque: float | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    options: EstimationOptions = DEFAULTS,
    threads: int | None = None,
    progress: progresses.Progress = progresses.no_progress,
) -> ExcitationDesign:
    """Design the most informative motion for estimating parameters, by CMA-ES on the information of simulated logs.

    1. Candidates move from rest to rest through way-points; the closed loop follows each in a simulation.
    2. The information of its log in the filter of `identify`, with the priors, gives the covariance of the estimates.
    3. CMA-ES (Hansen) minimises a criterion of the covariance; a violated limit adds a penalty.

    Args:
        keys: parameters to estimate, as for `identify`.
        experiment: machine, sensors and sea; its controller follows the motion; default: the ensemble's, or
            ``Experiment()``.
        duration: of the run in s.
        ensemble: name or file of an ensemble, such as ``rig``: parameters that it draws are estimated too, as in
            `identify`.
        priors: key → mean and standard deviation of a normal prior.
        criterion: ``D``: the volume of the estimates' confidence region; ``A``: the mean of their variances, each over
            its prior.
        track: farthest position in m; default: a metre before the end.
        speed: largest in m/s; default: the reference's.
        acceleration: largest in m/s²; default: by half of the ropes' largest net force (``options.excitation``).
        torque: largest of a motor in N m; default: any. Tensions stay within the controller's limits anyway.
        trials: number of simulated motions; default: ``options.excitation.max_trials``, or any number within `seconds`.
        seconds: time after which no further generation of motions begins.
        seed: of the search.
        options: of estimation and search.
        threads: default: one per core.
        progress: called after every generation with the share of the work that is done.

    Returns:
        The experiment with that motion, and its expected standard deviations compared with those of its own motion.
        After an interrupt (Ctrl-C), the best of the complete generations.

    Raises:
        ConfigurationError: a key, prior or limit out of range, or no motion within the limits.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before a motion within the limits was found.

    Example:
        >>> import dualwinch as dw
        >>> design = dw.excite("plant.vehicle.mass", dw.case(4), duration=10.0, trials=8)
        >>> design.experiment.reference.kind
        'way-points'
    """
    import cmaes

    began, search = perf_counter(), options.excitation
    if not search.min_duration <= arguments.one_number("duration", duration) <= search.max_duration:
        raise ConfigurationError(
            f"duration = {duration:g}: must be {search.min_duration:g} to {search.max_duration:g} s"
        )
    if criterion not in {"D", "A"}:
        raise ConfigurationError(f"criterion = {criterion}: must be D or A")
    if trials is not None:
        arguments.whole_number("trials", trials, 1)
    arguments.whole_number("seed", seed, most=LARGEST_SEED)
    trials = trials or (search.max_trials if seconds is None else None)
    arguments.instance("options", options, EstimationOptions)
    experiment, names, all_priors = problem_of(keys, experiment, ensemble, priors)
    limits = motion_limits(
        experiment, track=track, speed=speed, acceleration=acceleration, torque=torque, options=search
    )
    unknowns = unknown_parameters(names, experiment, all_priors, options.search)
    present = expected_covariance(_present_motion(experiment, duration), unknowns, None, options)
    size = motion_dimensions(duration, search)
    strategy = cmaes.CMA(np.full(size, 0.5), search.sigma, np.tile([0.0, 1.0], (size, 1)), seed=seed)
    nothing = ExpectedCovariance(None, np.inf, "no time for any motion")
    best: tuple[Cost, references.Reference | None, ExpectedCovariance] = ((math.inf, math.inf), None, nothing)
    tried, interrupted = 0, False

    def evaluate(point: Floats) -> tuple[Cost, references.Reference | None, ExpectedCovariance]:
        reference, expectation = motion_of(point, limits, duration, search), nothing._replace(violation=2.0)
        if reference:
            expectation = expected_covariance(with_motion(experiment, reference, duration), unknowns, limits, options)
        return _cost(expectation, unknowns, criterion), reference, expectation

    while (trials is None or tried < trials) and (seconds is None or perf_counter() - began < seconds or not tried):
        points = [strategy.ask() for _ in range(strategy.population_size)]
        try:
            evaluations = executors.map_all(evaluate, points, threads)
        except KeyboardInterrupt:
            if best[2].covariance is None:
                raise
            interrupted = True
            break
        order = sorted(range(len(points)), key=lambda place: evaluations[place][0])
        strategy.tell([(points[place], rank) for rank, place in enumerate(order)])  # it uses ranks alone
        best, tried = min([best, *evaluations], key=lambda each: each[0]), tried + len(points)
        spent = 0.0 if seconds is None else (perf_counter() - began) / seconds
        progress(min(max(spent, 0.0 if trials is None else tried / trials), 1.0))
    _, reference, expectation = best
    if reference is None or expectation.covariance is None:
        raise ConfigurationError(f"none of {tried} motions is within the limits; the nearest has {expectation.words}")
    return ExcitationDesign(
        experiment=with_motion(experiment, reference, duration),
        unknowns=unknowns,
        covariance=expectation.covariance,
        present=present.covariance,
        criterion=criterion,
        duration=duration,
        tried=tried,
        seed=seed,
        seconds=perf_counter() - began,
        interrupted=interrupted,
    )


def _present_motion(experiment: Experiment, duration: float) -> Experiment:
    """The experiment's own motion for the same duration, or for its own if it would otherwise leave the track."""
    longer = with_motion(experiment, experiment.reference, duration)
    try:
        preparation.prepare(longer)
    except ConfigurationError:
        return with_motion(
            experiment, experiment.reference, min(references.own_duration(experiment.reference), duration)
        )
    return longer


def _cost(there: ExpectedCovariance, unknowns: Sequence[UnknownParameter], criterion: Criterion) -> Cost:
    """The violation of limits, and the logarithm of a typical standard deviation over its prior."""
    if there.covariance is None:
        return max(there.violation, 0.0), math.inf
    by = np.array([each.uncertainty for each in unknowns])
    scaled = there.covariance / np.outer(by, by)
    if criterion == "A":
        return -math.inf, float(np.log(np.mean(np.diag(scaled))) / 2)
    return -math.inf, float(np.linalg.slogdet(scaled)[1] / (2 * len(by)))
