"""Diagnostics: plausibility checks, whiteness tests, unidentifiable directions, profile likelihoods."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm, pearsonr

from dualwinch.toolbox import ConfigurationError, Experiment, executors, physical_units, physics
from dualwinch.toolboxes.identification.estimate import ParameterEstimate, PredictionErrorMethod, on_worker
from dualwinch.toolboxes.identification.log import POSITIONS, TORQUES, UNIT_OF, Log, longest_step
from dualwinch.toolboxes.identification.noise import noise_by_differences
from dualwinch.toolboxes.identification.options import (
    DEFAULTS,
    DiagnosticsOptions,
    EstimationOptions,
    PlausibilityOptions,
)
from dualwinch.toolboxes.identification.predictor import READINGS
from dualwinch.toolboxes.identification.resample import LogSection
from dualwinch.toolboxes.identification.unknowns import UnknownParameter, covariance_of

Floats = NDArray[np.float64]


def check_log(log: Log, experiment: Experiment, options: PlausibilityOptions = DEFAULTS.plausibility) -> None:
    """Refuse a log with implausible columns.

    Raises:
        ConfigurationError: a column never changes, or must be in another unit; with the log's notes.
    """
    try:
        _check_changes(log)
        _check_ranges(log, experiment, options)
        _check_displacements(log, experiment, options)
        _check_step(log, experiment, options)
        _check_pulls(log, experiment, options)
    except ConfigurationError as error:
        raise log.refused(str(error)) from None


def _check_changes(log: Log) -> None:
    if all(np.nanmin(log.columns[name]) == np.nanmax(log.columns[name]) for name in TORQUES):
        raise ConfigurationError(f"{log.name}: tau_1, tau_2: never change, and torques drive the fit")
    for name in log.readings:
        low, high = float(np.nanmin(log.columns[name])), float(np.nanmax(log.columns[name]))
        if low == high:
            raise ConfigurationError(
                f"{log.name}: {name}: is {low:g} in every row; name another column (--column {name}=NAME) or leave it "
                f"out (--column {name}=-)"
            )


def _check_ranges(log: Log, experiment: Experiment, options: PlausibilityOptions) -> None:
    """Refuse a log with readings out of their ranges, and suggest units; a few such rows may be marks of gaps.

    Speeds with a wrong unit in most rows are left to `_check_displacements`.
    """
    for name, (lowest, high) in plausible_ranges(experiment, options).items():
        if name not in (*TORQUES, *log.readings):
            continue
        values = log.columns[name]
        low = _lowest_tension(values, lowest, experiment, options) if name in ("F1", "F2") else lowest
        rows = np.flatnonzero((values < low) | (values > high))
        few = 2 * len(rows) < np.isfinite(values).sum()
        if not len(rows) or not (few or name in (*TORQUES, *POSITIONS, "F1", "F2")):
            continue
        worst = values[rows[0]] if few else values[rows[np.abs(values[rows]).argmax()]]
        smallest, largest = np.nanmin(values), np.nanmax(values)
        fit = dict[str, float]()
        for unit, by in physical_units.UNITS[UNIT_OF[name]].items():
            for stated, extremes in (
                (f"-{unit}", (-by * smallest, -by * largest)),
                (unit, (by * smallest, by * largest)),
            ):
                if low <= min(extremes) and max(extremes) <= high:
                    fit = {each: size for each, size in fit.items() if size != by} | {stated: by}
        units = sorted(fit, key=lambda unit: -fit[unit])[:2] or ["UNIT"]
        where = f" in row {rows[0] + 1} (t = {log.t[rows[0]]:.12g} s)" if few else ""
        where += f" and {len(rows) - 1} others" if few and len(rows) > 1 else ""
        gap = "a mark for a gap (leave its cell empty) or " if few else ""
        raise ConfigurationError(
            f"{log.name}: {name} = {worst:.4g}{where}: must be {low:.3g} to {high:.3g} on this machine; is it {gap}in "
            f"another unit (--column {name}=NAME:{' or NAME:'.join(units)})?"
        )


def _lowest_tension(values: Floats, low: float, experiment: Experiment, options: PlausibilityOptions) -> float:
    """Lowest plausible reading of a load cell: `low`, or less of a push where a few readings are far below all others.

    A rope cannot push, but a cell's zero may be off, or its sign, and then in all rows.
    """
    push = options.max_excess * experiment.controller.limits.tension_max
    marks = values < -push
    few = 0 < 2 * marks.sum() < np.isfinite(values).sum()
    return -push if few and np.nanmin(values[~marks]) - values[marks].max() > push else low


def _check_displacements(log: Log, experiment: Experiment, options: PlausibilityOptions) -> None:
    """Refuse a log with contradictory positions, drum angles and integrated speeds, with the likeliest reason.

    1. Compute the displacement by each sensor, without gaps of the log.
    2. The displacement that agrees with most others is the right one.
    """
    steps, around = np.diff(log.t), dict[str, float]()
    inside = steps <= longest_step(log.t, DEFAULTS.resampling.max_gap)
    for side in experiment.plant.sides:
        radius = float(side.direction * side.winch.drum_radius)
        around |= {f"theta_{side.number}": radius, f"omega_{side.number}": radius}
    ways = dict[str, Floats]()
    for name in (name for name in (*POSITIONS, "v", "omega_1", "omega_2") if name in log.readings):
        rows = np.isfinite(log.columns[name])
        values = np.interp(log.t, log.t[rows], log.columns[name][rows]) * around.get(name, 1.0)
        changes = np.diff(values) if name in POSITIONS else steps * (values[1:] + values[:-1]) / 2
        way = np.cumsum(np.where(inside, changes, 0.0))
        ways[name] = way - way.mean()
    threshold = options.min_distance * experiment.plant.track.length
    candidates = [name for name in ways if ways[name].std() >= threshold]
    if not any(name in POSITIONS for name in candidates):
        return

    def ratio_of(one: str, other: str) -> float | None:
        """Ratio of the displacements of `one` and `other`; ``None`` if they are not correlated."""
        x, y = ways[one], ways[other]
        if abs(x @ y) <= options.min_correlation * np.sqrt((x @ x) * (y @ y)):
            return None
        return float(x @ y) / float(y @ y)

    def equal(ratio: float | None) -> bool:
        return ratio is not None and 1 / options.max_scale_ratio < ratio < options.max_scale_ratio

    same = {name: sum(equal(ratio_of(other, name)) for other in ways if other != name) for name in candidates}
    reference = max(candidates, key=lambda name: same[name])
    for name in ways:
        ratio = ratio_of(name, reference)
        if ratio is not None and not equal(ratio):
            reason = _reason(name, reference, ratio, log, experiment, options, sure=same[reference] > 0)
            raise ConfigurationError(f"{log.name}: {name} moves {ratio:.3g} times as far as {reference}: {reason}")


def _reason(
    name: str,
    reference: str,
    ratio: float,
    log: Log,
    experiment: Experiment,
    options: PlausibilityOptions,
    *,
    sure: bool,
) -> str:
    """The likeliest reason for a ratio of two readings' displacements; `sure`: the `reference` is right."""
    step, suggestions = float(np.median(np.diff(log.t))), list[str]()

    def add(reading: str, by: float) -> None:
        opposite = reading != "t" and 1 / options.max_scale_ratio < -by < options.max_scale_ratio
        unit = f"-{UNIT_OF[reading]}" if opposite else _unit_by(by, reading)
        _, high = plausible_ranges(experiment, options).get(reading, (0.0, np.inf))
        if unit and np.nanmax(np.abs(by * log.columns.get(reading, 0.0))) <= high:
            suggestions.append(
                f"{reading if suggestions or reading != name else 'it'} in {unit} (--column {reading}=NAME:{unit})"
            )

    if (name in POSITIONS) != (reference in POSITIONS):
        by = 1 / ratio if reference in POSITIONS else ratio
        if by > 1 or step > options.max_scale_ratio * experiment.simulation.sample_time:
            add("t", by)
    if not suggestions or step <= options.max_step_ratio * experiment.simulation.sample_time:
        add(name, 1 / ratio)
    if not sure:
        add(reference, ratio)
    return f"is {' or '.join(suggestions) or 'it in another unit, or of the motor'}?"


def _check_step(log: Log, experiment: Experiment, options: PlausibilityOptions) -> None:
    """Refuse a log with an implausible time step, and suggest units."""
    step, usual = float(np.median(np.diff(log.t))), experiment.simulation.sample_time
    low, high = usual / options.max_step_ratio, usual * options.max_step_ratio
    if low <= step <= high:
        return
    fit = {
        unit: abs(np.log(by * step / usual))
        for unit, by in physical_units.UNITS["s"].items()
        if low <= by * step <= high
    }
    likely = sorted(fit, key=lambda each: fit[each])[:2] or ["UNIT"]
    raise ConfigurationError(
        f"{log.name}: t: has a row every {step:.3g} s: must be {low:g} to {high:g} s; is it in another unit (--column "
        f"t=NAME:{' or NAME:'.join(likely)})?"
    )


def _check_pulls(log: Log, experiment: Experiment, options: PlausibilityOptions) -> None:
    """Refuse a log if its mean torques hold other tensions than its load cells read on average."""
    unit_torques = vars(physics.holding_torques(2.0, experiment.plant))  # 1 N in each rope
    for number in (1, 2):
        torque, tension = f"tau_{number}", f"F{number}"
        if tension not in log.readings:
            continue
        read, pull = np.nanmean(log.columns[tension]), np.nanmean(log.columns[torque]) / float(unit_torques[torque])
        ratio = float(pull / read) if read else 1.0
        if _is_of_size(ratio, options):
            continue
        if question := _swapped(log, unit_torques, options):
            raise ConfigurationError(
                f"{log.name}: {torque} holds {pull:.3g} N on average, and {tension} reads {read:.3g} N: {question}"
            )
        units = {name: _unit_by(by, name) for name, by in ((torque, 1 / ratio), (tension, ratio))}
        suggestions = [f"{name} in {unit} (--column {name}=NAME:{unit})" for name, unit in units.items() if unit]
        other = f"{torque} of the opposite sign (--column {torque}=NAME:-N m)" if ratio < 0 else "one in another unit"
        raise ConfigurationError(
            f"{log.name}: {torque} holds {pull:.3g} N on average, and {tension} reads {read:.3g} N: "
            f"is {' or '.join(suggestions) or other}?"
        )
    if _pulls_are_opposed(log, unit_torques, options):
        raise ConfigurationError(
            f"{log.name}: where tau_1 pulls more than tau_2, F1 reads less than F2: have F1 and F2 or tau_1 and tau_2 "
            "changed places?"
        )


def _is_of_size(ratio: float, options: PlausibilityOptions) -> bool:
    """Whether a ratio of pulls by torque and load cell is plausible: each may be off by the largest ratio."""
    return 1 / options.max_scale_ratio**2 < ratio < options.max_scale_ratio**2


def _pulls_are_opposed(log: Log, unit_torques: Mapping[str, float], options: PlausibilityOptions) -> bool:
    """Whether the sides' differences of torque and of tension are correlated negatively, each averaged over a time.

    Averaged because a drum that oscillates has them in opposite phase; strongly, and not by chance.
    """
    if not {"F1", "F2"} <= set(log.readings):
        return False
    pulls = [log.columns[torque] / float(unit_torques[torque]) for torque in TORQUES]
    rows = np.isfinite([*pulls, log.columns["F1"], log.columns["F2"]]).all(axis=0)
    _, window = np.unique((log.t[rows] // DEFAULTS.resampling.window).astype(int), return_inverse=True)

    def means(values: Floats) -> Floats:
        return np.bincount(window, values[rows]) / np.bincount(window)

    torques, tensions = means(pulls[0] - pulls[1]), means(log.columns["F1"] - log.columns["F2"])
    if len(tensions) < 2 or not (tensions.std() and torques.std()):
        return False
    test: Any = pearsonr(torques, tensions, alternative="less")
    return bool(test.statistic < -options.min_correlation and test.pvalue < options.improbable)


def _swapped(log: Log, unit_torques: Mapping[str, float], options: PlausibilityOptions) -> str | None:
    """The columns that fit on average after swapping the two sides, as a question; ``None`` if there are none."""
    if not {"F1", "F2"} <= set(log.readings):
        return None
    mean = {name: float(np.nanmean(log.columns[name])) for name in (*TORQUES, "F1", "F2")}
    side_pulls = [mean[torque] / float(unit_torques[torque]) for torque in TORQUES]
    cross_pulls = [
        mean[torque] / float(unit_torques[place]) for torque, place in zip(reversed(TORQUES), TORQUES, strict=True)
    ]
    pairs = list[str]()
    cases = ("F1 and F2", side_pulls, ("F2", "F1")), ("tau_1 and tau_2", cross_pulls, ("F1", "F2"))
    for what, pulls, reads in cases:
        ratios = [pull / mean[read] if mean[read] else 1.0 for pull, read in zip(pulls, reads, strict=True)]
        if all(_is_of_size(ratio, options) for ratio in ratios):
            pairs.append(what)
    return f"have {' or '.join(pairs)} changed places?" if pairs else None


def _unit_by(by: float, name: str) -> str | None:
    """The unit, other than SI, with a factor near `by`; ``None`` if there is none."""
    units = {unit: factor for unit, factor in physical_units.UNITS[UNIT_OF[name]].items() if factor != 1}
    unit = min(units, key=lambda each: abs(np.log(units[each] / by)), default=None) if by > 0 else None
    return unit if unit and abs(np.log(units[unit] / by)) < 0.2 else None


def plausible_ranges(experiment: Experiment, options: PlausibilityOptions) -> dict[str, tuple[float, float]]:
    """Column → lowest and highest plausible value in a log of such a machine, in SI units."""
    plant, strongest = experiment.plant, options.max_tension_ratio * experiment.controller.limits.tension_max
    length, radius_1, radius_2 = plant.track.length, plant.winch_1.drum_radius, plant.winch_2.drum_radius
    margin, torques = options.max_excess * length, physics.holding_torques(2 * strongest, plant)
    farthest, fastest = length + margin, length  # in m/s: the track in a second
    return {
        "x": (-margin, farthest),
        "F1": (-strongest, strongest),
        "F2": (-strongest, strongest),
        "theta_1": (-farthest / radius_1, farthest / radius_1),
        "theta_2": (-farthest / radius_2, farthest / radius_2),
        "tau_1": (-float(torques.tau_1), float(torques.tau_1)),
        "tau_2": (-float(torques.tau_2), float(torques.tau_2)),
        "v": (-fastest, fastest),
        "omega_1": (-fastest / radius_1, fastest / radius_1),
        "omega_2": (-fastest / radius_2, fastest / radius_2),
    }


class ImplausibleFitError(ConfigurationError):
    """A fit needs large unrecorded torques or noise: the model lacks something, or the log is of another machine."""


class UnrecordedForceError(ImplausibleFitError):
    """A fit needs a large unrecorded force: the model lacks a sea, or the log is of another machine."""


def check_fit(
    estimate: ParameterEstimate,
    sections: Sequence[LogSection],
    experiment: Experiment,
    options: EstimationOptions = DEFAULTS,
    unrecorded: float | None = None,
) -> tuple[str, ...]:
    """Refuse a fit with implausibly large unrecorded disturbances or noise.

    Returns:
        Notes on disturbances above ``options.plausibility.max_unrecorded`` but below `unrecorded`, if that is given.

    Raises:
        UnrecordedForceError: unrecorded forces too large in relation to recorded ones.
        ImplausibleFitError: unrecorded torques likewise, or residuals of a sensor far larger than its own noise.
    """
    plausibility, name = options.plausibility, sections[0].name
    limit = plausibility.max_unrecorded if unrecorded is None else unrecorded
    recorded = np.concatenate([section.torques for section in sections])
    unit_torques = physics.holding_torques(2.0, experiment.plant)  # 1 N in each rope
    pulls = recorded[:, 0] / float(unit_torques.tau_1), recorded[:, 1] / float(unit_torques.tau_2)
    torque, force = float(np.sqrt(np.mean(recorded**2))), float(np.sqrt(np.mean(pulls[0] ** 2 + pulls[1] ** 2)))
    noise = {key: each.deviation for key, each in estimate.noise.process.items()}
    readings = np.concatenate([section.readings for section in sections])
    counts = np.isfinite(readings).sum(axis=0)
    has_motion = counts[[READINGS.index(reading) for reading in ("x", "v", "F1", "F2")]].any()
    excess = {
        f"unrecorded torques of {noise['torque_1']:.3g} N m would be needed besides the recorded {torque:.3g} N m": (
            noise["torque_1"] / torque
        ),
        f"an unrecorded force of {noise['force']:.3g} N on the vehicle would be needed besides the {force:.3g} N of "
        "the ropes": noise["force"] / force if has_motion else 0.0,
    }
    unlike = f"it is of another machine, {other_reasons(sections, experiment, plausibility)}"
    for words, share in excess.items():
        if share > limit:
            accept = (
                f" (--unrecorded {share + 0.005:.0%} accepts it)" if share < 1 - plausibility.max_unrecorded else ""
            )
            refused = UnrecordedForceError if "unrecorded force" in words else ImplausibleFitError
            raise refused(f"{name}: {words}: {unlike}{accept}")
    jumps = noise_by_differences(readings, experiment, options.noise)
    ratios = np.sqrt(estimate.noise.measurement) / jumps
    for index, reading in enumerate(READINGS):
        if counts[index] and ratios[index] > plausibility.max_noise_ratio:
            raise ImplausibleFitError(
                f"{name}: {reading}: its residual is {jumps[index] * ratios[index]:.3g} (s.d.), its own noise "
                f"{jumps[index]:.3g}: {unlike}"
            )
    return tuple(
        f"{words}: the model lacks something" for words, share in excess.items() if share > plausibility.max_unrecorded
    )


def other_reasons(
    sections: Sequence[LogSection], experiment: Experiment, options: PlausibilityOptions = DEFAULTS.plausibility
) -> str:
    """Other reasons why torques do not explain the readings, in words."""
    changes = [np.diff(section.torques, axis=0) for section in sections]
    every = np.concatenate(changes)
    jumps = every[every.any(axis=1)]
    samples = len(every) / max(len(jumps), 1)
    if samples > options.max_scale_ratio * 0.75:
        step = 1e3 * samples * experiment.simulation.sample_time
        return f"or its torques change faster than they were logged, every {step:.3g} ms: log every command"
    cells = [READINGS.index(name) for name in ("F1", "F2")]
    read = any(np.isfinite(section.readings[:, cells]).any() for section in sections)
    return "or its torques are late" if read else "or tau_1 or tau_2 is of another sign or unit, or late"


@dataclass(frozen=True)
class WhitenessTest:
    """Whether the whitened innovations of a sensor are white noise.

    Attributes:
        name: of the reading.
        count: number of readings.
        variance: of the whitened innovations; 1 if the model is right.
        correlation, lag: the largest autocorrelation in magnitude, and its lag in samples.
        torque_correlation, torque_lag: the largest correlation with changes of the torques, and its lag in samples.
        bound: magnitude up to which a correlation is insignificant or negligible.
    """

    name: str
    count: int
    variance: float
    correlation: float
    lag: int
    torque_correlation: float
    torque_lag: int
    bound: float

    @property
    def white(self) -> bool:
        """Whether no correlation exceeds the bound."""
        return max(abs(self.correlation), abs(self.torque_correlation)) <= self.bound

    @property
    def words(self) -> str:
        """The verdict in words."""
        if self.white:
            return "white"
        if abs(self.torque_correlation) > abs(self.correlation):
            return f"correlated with torque steps: {self.torque_correlation:+.2f} at lag {self.torque_lag}"
        return f"autocorrelated: {self.correlation:+.2f} at lag {self.lag}"


def whiteness_tests(
    innovations: Sequence[Floats], torques: Sequence[Floats], options: DiagnosticsOptions = DEFAULTS.diagnostics
) -> tuple[WhitenessTest, ...]:
    """Test the whitened innovations of every sensor for correlation with their own past and that of the torques.

    Innovations are (samples, readings) for each section, NaN without a reading; torques (samples, 2).
    """
    tests, lags = [], options.lags
    for column, name in enumerate(READINGS):
        values = [section[:, column] for section in innovations]
        count = sum(int(np.isfinite(each).sum()) for each in values)
        if count < 2 * lags:
            continue
        variance = sum(float(np.nansum(each**2)) for each in values) / count
        correlations = _correlations(values, values, lags)
        changes = [[np.diff(each[:, side], prepend=each[0, side]) for each in torques] for side in (0, 1)]
        sides = np.array([_correlations(each, values, lags) for each in changes])
        by = np.where(np.abs(sides[0]) >= np.abs(sides[1]), *sides)
        peak, torque_peak = int(np.argmax(np.abs(correlations))), int(np.argmax(np.abs(by)))
        chance = float(norm.ppf(1 - (1 - options.confidence) / (2 * lags)) / np.sqrt(max(count, 1)))
        tests.append(
            WhitenessTest(
                name=name,
                count=count,
                variance=variance,
                correlation=float(correlations[peak]),
                lag=peak + 1,
                torque_correlation=float(by[torque_peak]),
                torque_lag=torque_peak + 1,
                bound=max(chance, options.negligible_correlation),
            )
        )
    return tuple(tests)


def _correlations(first: Sequence[Floats], second: Sequence[Floats], lags: int) -> Floats:
    """(lags,) correlation of the first with the second, 1 to `lags` samples later.

    Where few pairs of readings have a lag, as between rows that are not at the samples, it is reduced by the root of
    their share, so that one bound holds for all lags.
    """
    sums = np.zeros((4, lags))
    for both in zip(first, second, strict=True):
        a, b = (np.where(np.isfinite(values), values, 0.0) for values in both)
        here, later = (np.isfinite(values).astype(float) for values in both)
        pairs = (a, b), (a**2, later), (here, b**2), (here, later)
        sums += [[np.einsum("i,i->", x[:-lag], y[lag:]) for lag in range(1, lags + 1)] for x, y in pairs]
    products, size = sums[0], np.sqrt(sums[1] * sums[2])
    correlations = np.divide(products, size, out=np.zeros(lags), where=size > 0)
    return correlations * np.sqrt(sums[3] / max(float(sums[3].max(initial=0.0)), 1.0))


def rms_innovations(
    innovations: Sequence[Floats], step: float, window: float = DEFAULTS.resampling.window
) -> dict[str, Floats]:
    """Reading → (2, windows) time in s, and root mean square of the whitened innovations, in time windows."""
    every = np.concatenate(innovations)
    count = max(1, int(step * len(every) / window))
    starts = np.array([window[0] for window in np.array_split(np.arange(len(every)), count)])
    lengths = np.diff(starts, append=len(every))
    times = step * (starts + (lengths - 1) / 2)
    numbers = np.add.reduceat(np.isfinite(every), starts, dtype=float)
    with np.errstate(invalid="ignore"):  # no reading in a window
        sizes = np.sqrt(np.add.reduceat(np.nan_to_num(every) ** 2, starts) / numbers)
    pairs = zip(READINGS, sizes.T, strict=True)
    return {name: np.array([times, size]) for name, size in pairs if np.isfinite(size).any()}


@dataclass(frozen=True)
class UnidentifiableDirection:
    """A direction in which parameters can change together without any effect on the readings.

    Attributes:
        keys: its main parameters, the largest component first.
        deviation: of the direction by the logs alone, over the parameters' uncertainties; infinite: no information.
    """

    keys: tuple[str, ...]
    deviation: float

    @property
    def words(self) -> str:
        """The direction in a sentence."""
        key, *partners = self.keys
        if not partners:
            return f"{key}: the logs contain next to no information on it"
        return f"{key}: identifiable only together with {' and '.join(partners)}"


def unidentifiable_directions(
    information: Floats, unknowns: Sequence[UnknownParameter], options: DiagnosticsOptions = DEFAULTS.diagnostics
) -> tuple[UnidentifiableDirection, ...]:
    """Eigenvectors of the logs' (p, p) information with less information than the priors, the worst first.

    Their main parameters are the largest components, which make up a share of it, that from which estimates count as
    correlated.
    """
    by = np.array([each.uncertainty for each in unknowns])
    eigenvalues, vectors = np.linalg.eigh(information * np.outer(by, by))
    directions = []
    for eigenvalue, vector in zip(eigenvalues, vectors.T, strict=True):
        if eigenvalue >= 1:
            continue
        order = np.argsort(-np.abs(vector))
        sums = np.cumsum(vector[order] ** 2)
        main = order[: 1 + int(np.searchsorted(sums, options.correlated))].tolist()
        deviation = float(1 / np.sqrt(eigenvalue)) if eigenvalue > 0 else np.inf
        directions.append(UnidentifiableDirection(tuple(unknowns[index].key for index in main), deviation))
    return tuple(directions)


def uninformed_keys(unknowns: Sequence[UnknownParameter], deviations: Floats) -> tuple[str, ...]:
    """Keys on which the logs have less information than the prior, by posterior deviations."""
    return tuple(
        unknown.key
        for unknown, deviation in zip(unknowns, deviations.tolist(), strict=True)
        if unknown.prior and 2 * deviation**2 > unknown.prior.deviation**2
    )


def sandwich_factors(method: PredictionErrorMethod, estimate: ParameterEstimate) -> Floats:
    """(p,) factors by which the sandwich covariance widens the standard deviations, at least 1.

    The gradient of the innovations is summed over blocks of time; the covariance of these sums replaces the
    information, which equals it only for white innovations (White, Econometrica 50 (1982) 1; batch means).
    """
    filters, experiment, noise = method.filters, estimate.experiment, estimate.noise
    parameters, blocks, scores = filters.parameters(experiment, noise), method.options.diagnostics.blocks, []
    for section, filter_pass in zip(filters.sections, filters.run(experiment, noise), strict=True):
        ends = np.linspace(0, len(section.inputs), blocks + 1).astype(int)[1:].tolist()
        sums = [
            method.filters_of([section.upto(end)])
            .predict(parameters, experiment, noise, [filter_pass])[0]
            .normal[:-1, -1]
            for end in ends
        ]
        block_scores = np.diff(sums, axis=0, prepend=0.0)
        scores.append(block_scores - block_scores.mean(axis=0))
    every = np.concatenate(scores)
    prior = np.diag([1 / each.uncertainty**2 for each in method.unknowns])
    middle = every.T @ every * blocks / (blocks - 1) + prior
    covariance = covariance_of(estimate.information, method.unknowns)
    return np.sqrt(np.maximum(np.diag(covariance @ middle @ covariance) / np.diag(covariance), 1.0))


@dataclass(frozen=True, eq=False)
class LikelihoodProfile:
    """The profile likelihood of a parameter: all others are estimated again at each of its values.

    If it is a parabola, the standard deviation suffices; else its own interval is the right one (Raue et al.,
    Bioinformatics 25 (2009) 1923).

    Attributes:
        key: of the parameter.
        values: (n,) of the parameter, ascending.
        rise: (n,) of the deviance above its minimum.
    """

    key: str
    values: Floats
    rise: Floats

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval; an end is infinite if the profile does not rise to the bound."""
        bound = np.sqrt(float(chi2.ppf(0.95, 1)))
        best = int(np.argmin(self.rise))
        ends = []
        for side in (slice(best, None, -1), slice(best, None)):
            values, root = self.values[side], np.sqrt(np.maximum(self.rise[side], 0.0))
            crossings = np.flatnonzero(root >= bound)
            if not len(crossings) or crossings[0] == 0:
                ends.append(np.inf * (1 if ends else -1))
                continue
            two = slice(crossings[0] - 1, crossings[0] + 1)  # the root of a parabola is a straight line
            ends.append(float(np.interp(bound, root[two], values[two])))
        return ends[0], ends[1]


def likelihood_profiles(
    method: PredictionErrorMethod, estimate: ParameterEstimate, keys: Sequence[str], workers: executors.Workers = None
) -> tuple[LikelihoodProfile, ...]:
    """Profile likelihoods of several parameters; an executor's workers compute them in parallel."""
    if isinstance(workers, Executor):
        tasks = ((likelihood_profile, method.made_of, estimate, key) for key in keys)
        return tuple(executors.in_order(executors.spread(workers, on_worker, tasks)))
    return tuple(likelihood_profile(method, estimate, key) for key in keys)


def likelihood_profile(method: PredictionErrorMethod, estimate: ParameterEstimate, key: str) -> LikelihoodProfile:
    """The profile likelihood of a parameter around the best estimate, with fixed R and Q."""
    options, unknowns = method.options.diagnostics, method.unknowns
    index = next(number for number, unknown in enumerate(unknowns) if unknown.key == key)
    covariance = covariance_of(estimate.information, unknowns)
    unknown, deviation = unknowns[index], np.sqrt(covariance[index, index])
    coordinates = method.coordinates(itself=index)

    def maximised(at: Floats, fixed: int | None) -> tuple[Floats, float]:
        """Coordinates of the largest likelihood, possibly with one coordinate fixed, and the deviance there."""
        maximum = method.likelihood.maximum(at, estimate.noise, coordinates, fixed, size=1.0)
        return (maximum.at, maximum.deviance) if maximum else (at, np.inf)

    best, minimum = maximised(coordinates.of(estimate.values), None)
    value = float(coordinates.values(best)[index])
    rises, direction = {value: 0.0}, covariance[:, index] / covariance[index, index]
    points = options.profile_points
    for way in (-1, 1):
        at, last = best, value
        for number in range(1, points + 1):
            target = value + way * method.options.search.reach * deviation * number / points
            fixed = float(np.clip(target, unknown.lower, unknown.upper))
            if fixed in rises:
                break
            start = coordinates.of(coordinates.values(at) + direction * (fixed - last))
            at, deviance = maximised(start, index)
            rises[fixed], last = deviance - minimum, fixed
    return LikelihoodProfile(key, np.array(sorted(rises)), np.array([rises[each] for each in sorted(rises)]))
