"""Unknown parameters: keys, ranges and priors, and the coordinates of the search."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Ensemble,
    Experiment,
    Mark,
    arguments,
    description,
    ensemble_file,
    leaves,
    quantities,
    with_leaves,
)
from dualwinch.toolboxes.identification.options import DEFAULTS, EstimationOptions, SearchOptions
from dualwinch.toolboxes.identification.predictor import (
    PREDICTOR_GROUPS,
    RecordedExperiment,
    has_vortex_states,
    parameter_names,
    predictor_structure,
)

Floats = NDArray[np.float64]

PREFIXES = tuple(f"{group}." for group in PREDICTOR_GROUPS)

NOT_FITTED = (
    "sensors.position_noise", "sensors.speed_noise", "sensors.tension_noise", "sensors.position_resolution",
    "sensors.encoder_counts", "sensors.position_drift",
)  # fmt: skip
"""Parameters of noise and quantisation: they are part of R, or have no effect on the predictions."""

OVERLOADS = ("disturbance.push.", "disturbance.payload.", "disturbance.dropout_")
"""Prefixes of parameters of single events, which are no properties of the machine."""

STROUHAL, AMPLITUDE = "disturbance.strouhal", "disturbance.vortex_amplitude"

LOAD_CELL_LAG = "sensors.load_cell_time_constant"

NUISANCES = (
    "plant.winch_*.inertia", "plant.winch_*.coulomb_friction", "plant.rope_*.damping",
    LOAD_CELL_LAG, STROUHAL, AMPLITUDE,
)  # fmt: skip
"""Nuisance parameters, estimated too if innovations are not white without them."""

WAVES = {"eccentricity_angle": "eccentricity", "ripple_angle": "torque_ripple"}
"""End of the key of a wave's angle → that of its amplitude."""


@dataclass(frozen=True)
class Prior:
    """Normal prior distribution of a parameter."""

    mean: float
    deviation: float


def prior_of(key: str, given: Prior | tuple[float, float]) -> Prior:
    """The prior of a key, from mean and deviation.

    Raises:
        ConfigurationError: it is no pair of finite numbers, or the deviation is not positive.
    """
    try:
        mean, deviation = map(float, vars(given).values() if isinstance(given, Prior) else given)
    except (TypeError, ValueError):
        mean = deviation = math.nan
    if not (math.isfinite(mean) and 0 < deviation < math.inf):
        raise ConfigurationError(
            f"--prior {key}: {given!r}: must be mean and deviation, finite numbers, the deviation > 0, e.g. (1e4, 500)"
        )
    return Prior(mean, deviation)


@dataclass(frozen=True)
class UnknownParameter:
    """A parameter to estimate.

    Attributes:
        key: of the experiment.
        unit: its unit.
        start: initial value of the search.
        lower, upper: its range.
        scale: size of a large change.
        prior: its prior; ``None``: none.
    """

    key: str
    unit: str
    start: float
    lower: float
    upper: float
    scale: float
    prior: Prior | None = None

    @property
    def cyclic(self) -> bool:
        """Whether it is an angle, the same after a whole turn."""
        return self.key.endswith("_angle")

    @property
    def uncertainty(self) -> float:
        """Its prior deviation, else its scale."""
        return self.prior.deviation if self.prior else self.scale


def estimable_keys(patterns: Sequence[str], experiment: Experiment, option: str = "--fit") -> tuple[str, ...]:
    """Keys that match patterns such as ``plant.rope_*.modulus``, without repetition and without switches.

    Raises:
        ConfigurationError: a pattern that matches no parameter of the predictor; the message names the option.
    """
    structure = predictor_structure(experiment)
    described, values = description.describe_parts(experiment), leaves(experiment)
    switches = {key for key, leaf in described.items() if leaf.kind is bool}
    left_out = {
        key
        for key, leaf in described.items()
        if key.startswith(PREFIXES) and Mark.SHAPES_CODE_AT_ZERO in leaf.marks and not values[key]
    }
    candidates = [
        key
        for key in parameter_names(structure)
        if key.startswith(PREFIXES) and not key.startswith(OVERLOADS) and key not in {*NOT_FITTED, *switches}
    ]
    keys: dict[str, None] = {}
    for pattern in (part.strip() for text in patterns for part in text.split(",")):
        matching = [key for key in candidates if fnmatchcase(key, pattern)]
        if not matching:
            hint = (
                "it is true or false; --set sets it"
                if pattern in switches
                else quantities.suggestion(pattern, candidates)
            )
            if pattern in left_out:
                hint = f"0 leaves it out of the model; begin with an expected value, --set {pattern}=..."
            raise ConfigurationError(f"{option} {pattern}: no parameter that a log determines; {hint}")
        keys |= dict.fromkeys(matching)
    return tuple(keys)


def unknown_parameters(
    keys: Sequence[str], experiment: Experiment, priors: Mapping[str, Prior], options: SearchOptions = DEFAULTS.search
) -> tuple[UnknownParameter, ...]:
    """The unknown parameters of given keys, with their ranges.

    Raises:
        ConfigurationError: a prior of a key that is not fitted, or outside its range.
    """
    for key in priors:
        if key not in keys:
            raise ConfigurationError(
                f"--prior {key}: is not fitted; add it to --fit; {quantities.suggestion(key, keys)}"
            )
    values, described, factor = leaves(experiment), description.describe_parts(experiment), options.range_factor
    parameters = []
    for key in keys:
        leaf, prior = described[key], priors.get(key)
        lower, upper = leaf.bounds
        if prior and not lower <= prior.mean <= upper:
            raise ConfigurationError(f"--prior {key}={prior.mean:g}: must be {leaf.wanted}")
        start = prior.mean if prior else float(values[key])
        sizes = {"m": options.length, "N": options.share * experiment.controller.limits.tension_max, "1": options.share}
        usual = sizes.get(leaf.quantity.unit, 1.0)
        scale = prior.deviation if prior else abs(start) or usual
        lowest = start / factor if lower >= 0 < start and not prior else start - factor * scale
        ends = max(lower, lowest), min(upper, start + factor * scale)
        parameters.append(UnknownParameter(key, leaf.quantity.unit, start, *ends, scale, prior))
    return tuple(parameters)


def data_sheet_parameters(
    keys: Sequence[str], experiment: Experiment, readings: Collection[str], options: EstimationOptions = DEFAULTS
) -> tuple[UnknownParameter, ...]:
    """Gains, zeros and scales by data sheets (`DataSheetOptions`) of recorded sensors and of motors, except `keys`.

    Their priors have the experiment's values as means.
    """
    sheet, full_scale = options.data_sheet, experiment.controller.limits.tension_max
    deviations = {"sensors.speed_error": sheet.speed_error} if "v" in readings else {}
    for number in (1, 2):
        deviations[f"plant.winch_{number}.torque_error"] = sheet.torque_error
        if f"F{number}" in readings:
            deviations[f"sensors.load_cell_error_{number}"] = sheet.load_cell_error
            deviations[f"sensors.load_cell_zero_{number}"] = sheet.load_cell_zero * full_scale
    return _uncertain(deviations, keys, experiment, options)


def clock_parameters(
    keys: Sequence[str], experiment: Experiment, options: EstimationOptions = DEFAULTS
) -> tuple[UnknownParameter, ...]:
    """Phase and rate of a recorder with a clock of its own, except `keys`; none for other experiments."""
    if not isinstance(experiment, RecordedExperiment):
        return ()
    deviations = {
        "recorder.phase": experiment.simulation.sample_time,
        "recorder.rate_error": options.data_sheet.clock_rate,
    }
    return _uncertain(deviations, keys, experiment, options)


def _uncertain(
    deviations: Mapping[str, float], keys: Sequence[str], experiment: Experiment, options: EstimationOptions
) -> tuple[UnknownParameter, ...]:
    """Parameters except `keys`, with priors of these deviations about the experiment's values; 0: left out."""
    values = leaves(experiment)
    priors = {
        key: Prior(float(values[key]), deviation)
        for key, deviation in deviations.items()
        if deviation and key not in keys
    }
    return unknown_parameters(tuple(priors), experiment, priors, options.search)


def nuisance_parameters(
    keys: Sequence[str], experiment: Experiment, options: SearchOptions = DEFAULTS.search
) -> tuple[UnknownParameter, ...]:
    """Nuisance parameters, with wide priors around the experiment's values, except `keys`.

    Inertia of the winches, friction of their drums, damping of the ropes, lag of load cells and, for vortices, their
    Strouhal number and, unless it is a state, their amplitude. Friction, damping and lag, which hardly anyone knows,
    have priors as wide as their values.
    """
    values, described, parameters = leaves(experiment), description.describe_parts(experiment), list[UnknownParameter]()
    for key in estimable_keys(["*"], experiment) if options.nuisance_share else ():
        value = float(values[key])
        if key in keys or value <= 0 or not any(fnmatchcase(key, pattern) for pattern in NUISANCES):
            continue
        if (key in (STROUHAL, AMPLITUDE) and not experiment.disturbance.vortex) or (
            key == AMPLITUDE and has_vortex_states(experiment)
        ):
            continue
        shares = {STROUHAL: options.strouhal_share, AMPLITUDE: options.amplitude_share}
        share = options.nuisance_share if key.endswith("inertia") else shares.get(key, 1.0)
        reach = 1 + options.range_factor * share
        unit, prior = described[key].quantity.unit, Prior(value, share * value)
        lowest = 0.0 if share == 1 and key != LOAD_CELL_LAG else value / reach
        parameters.append(UnknownParameter(key, unit, value, lowest, value * reach, share * value, prior))
    return tuple(parameters)


def with_drum_friction(experiment: Experiment, options: SearchOptions = DEFAULTS.search) -> Experiment:
    """An experiment with drum friction of a typical share of the drum's largest torque, where it describes none."""
    friction = options.drum_friction * experiment.controller.limits.tension_max
    values = {
        f"plant.winch_{side.number}.coulomb_friction": friction * side.winch.drum_radius
        for side in experiment.plant.sides
        if not side.winch.coulomb_friction
    }
    return with_leaves(experiment, values)


def with_load_cell_lag(experiment: Experiment, lag: float) -> Experiment:
    """An experiment with another lag of the load cells in s; 0: none."""
    return replace(experiment, sensors=replace(experiment.sensors, load_cell_time_constant=lag))


def with_sea(experiment: Experiment, options: SearchOptions = DEFAULTS.search) -> Experiment:
    """An experiment with vortices, current and changing rail load of a moderate sea, where it describes none."""
    disturbance = experiment.disturbance
    sea = replace(
        disturbance,
        vortex=True,
        current_sigma=disturbance.current_sigma or options.current_sigma,
        normal_force_sigma=disturbance.normal_force_sigma or options.normal_force_sigma,
    )
    return replace(experiment, disturbance=sea)


def problem_of(
    keys: str | Sequence[str],
    experiment: Experiment | None,
    ensemble: str | PathLike[str] | Ensemble | None,
    priors: Mapping[str, Prior | tuple[float, float]] | None,
) -> tuple[Experiment, tuple[str, ...], dict[str, Prior]]:
    """The experiment, all keys to estimate, and their priors; arguments as in `identification.identify.identify`.

    Raises:
        ConfigurationError: an ensemble that cannot be read, or a key that no log determines.
    """
    keys = arguments.texts("keys", keys)
    arguments.instance("experiment", experiment, Experiment, optional=True)
    arguments.instance("ensemble", ensemble, Ensemble, str, PathLike, optional=True)
    arguments.instance("priors", priors, Mapping, optional=True)
    machines = ensemble_file.load_ensemble(ensemble) if isinstance(ensemble, (str, PathLike)) else ensemble
    experiment = experiment or (machines.experiment if machines else Experiment())
    fit_keys = estimable_keys(keys, experiment)
    all_priors = {key: prior_of(key, prior) for key, prior in (priors or {}).items()}
    for key in all_priors:
        if estimable_keys([key], experiment, "--prior") != (key,):
            raise ConfigurationError(f"--prior {key}: must be one key, without *")
    if machines:
        all_priors = ensemble_priors(machines, experiment, without=(*fit_keys, *all_priors)) | all_priors
    if not fit_keys and not all_priors:
        raise ConfigurationError("keys: must name at least one parameter, such as plant.vehicle.mass")
    return experiment, (*fit_keys, *(key for key in all_priors if key not in fit_keys)), all_priors


def ensemble_priors(
    ensemble: Ensemble, experiment: Experiment, without: Sequence[str] = (), quantiles: int = 200
) -> dict[str, Prior]:
    """Priors of the parameters that an ensemble draws and a log determines, except the keys `without`.

    Mean and deviation are computed from quantiles of each distribution.
    """
    values, candidates = leaves(experiment), set(estimable_keys(["*"], experiment)) - set(without)
    shares, priors = (np.arange(quantiles) + 0.5) / quantiles, {}
    for key, distribution in ensemble.distributions.items():
        if key in candidates:
            draws = np.array([float(distribution.value(share, values[key])) for share in shares.tolist()])
            priors[key] = Prior(float(draws.mean()), float(draws.std()))
    return priors


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class UncertainEstimates:
    """Unknown parameters, and the covariance of their estimates' errors.

    Attributes:
        unknowns: the parameters to estimate.
        covariance: (p, p) of the errors, priors included.
    """

    unknowns: tuple[UnknownParameter, ...]
    covariance: Floats

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the parameters."""
        return tuple(unknown.key for unknown in self.unknowns)

    @property
    def deviations(self) -> Floats:
        """(p,) standard deviations of the errors."""
        return np.sqrt(np.diag(self.covariance))


def covariance_of(information: Floats, unknowns: Sequence[UnknownParameter]) -> Floats:
    """(p, p) covariance of the unknown parameters from the logs' information and their priors.

    A parameter without a prior gets one with its scale as deviation.
    """
    prior = np.array([1 / each.uncertainty**2 for each in unknowns])
    by = np.array([each.scale for each in unknowns])
    scaled = (information + np.diag(prior)) * np.outer(by, by)
    return np.asarray(np.linalg.inv(scaled) * np.outer(by, by), np.float64)


def unwrapped(values: Floats, unknowns: Sequence[UnknownParameter]) -> Floats:
    """Values, with angles moved by whole turns to within half a turn of their starts."""
    starts, angles = np.array([each.start for each in unknowns]), np.array([each.cyclic for each in unknowns])
    return np.where(angles, starts + np.remainder(values - starts + np.pi, 2 * np.pi) - np.pi, values)


class SearchCoordinates:
    """Coordinates of the search: each unknown over its scale, a wave by its cosine and sine parts.

    Amplitude and angle of a wave, if both are unknown, are replaced by its parts, because they are singular at zero:
    there the angle is undefined, and a search that arrives there stays. In its parts, zero is a regular point.

    Attributes:
        waves: indices of amplitude and angle of each wave.
        known: (p,) 1 for an unknown with a prior, else 0.
        bounds: (p,) each, of the coordinates.
        start: (p,) initial coordinates of the search.
        prior_rows, prior_centre: (m, p) and (p,): rows times the coordinates less the centre are standard normal
            variables. If amplitude and angle of a wave both have a prior, the prior of its parts is approximated as
            normal with their mean and covariance.
    """

    def __init__(
        self,
        unknowns: Sequence[UnknownParameter],
        within: float = np.inf,
        itself: int | None = None,
    ) -> None:
        """Coordinates of p unknowns, bounded to `within` prior deviations from their prior means.

        The unknown with the index `itself` remains a coordinate even if it is part of a wave.
        """
        self._unknowns, self._least = tuple(unknowns), float(np.finfo(float).eps ** 0.25)
        self._scale = np.array([unknown.scale for unknown in unknowns])
        self.waves = tuple(wave for wave in _waves(unknowns) if itself not in wave)
        self.known = np.array([each.prior is not None for each in unknowns], float)
        lower, upper = (np.array([getattr(each, end) for each in unknowns]) / self._scale for end in ("lower", "upper"))
        start = np.array([each.start for each in unknowns]) / self._scale
        likely = np.where(self.known, within, np.inf)
        lower, upper = np.maximum(lower, start - likely), np.minimum(upper, start + likely)
        for amplitude, angle in self.waves:
            lower[[amplitude, angle]], upper[[amplitude, angle]] = -upper[amplitude], upper[amplitude]
        self.bounds = lower, upper
        self.start = self.of(np.array([each.start for each in unknowns]))
        self.prior_rows, self.prior_centre = self._prior()

    def of(self, values: Floats) -> Floats:
        """(p,) coordinates of values, within bounds."""
        coordinates = values / self._scale
        for amplitude, angle in self.waves:
            size, at = values[amplitude] / self._scale[amplitude], values[angle]
            coordinates[amplitude], coordinates[angle] = size * np.cos(at), size * np.sin(at)
        return np.clip(coordinates, *self.bounds)

    def values(self, coordinates: Floats) -> Floats:
        """(p,) values; angles within half a turn of zero."""
        values = coordinates * self._scale
        for amplitude, angle in self.waves:
            cosine, sine = coordinates[amplitude], coordinates[angle]
            size = np.clip(np.hypot(cosine, sine), self._least, self.bounds[1][amplitude])
            values[amplitude], values[angle] = size * self._scale[amplitude], np.arctan2(sine, cosine)
        return values

    def jacobian(self, coordinates: Floats) -> Floats:
        """(p, p) derivatives of values with respect to coordinates."""
        jacobian = np.diag(self._scale)
        for amplitude, angle in self.waves:
            at = np.arctan2(coordinates[angle], coordinates[amplitude])
            size = max(float(np.hypot(coordinates[amplitude], coordinates[angle])), self._least)
            both = np.ix_([amplitude, angle], [amplitude, angle])
            by = self._scale[amplitude]
            jacobian[both] = [[by * np.cos(at), by * np.sin(at)], [-np.sin(at) / size, np.cos(at) / size]]
        return jacobian

    def room(self, at: Floats, way: Floats) -> float:
        """Largest factor on a direction `way` from given coordinates that remains within bounds."""
        lower, upper = self.bounds
        ends = np.where(way > 0, upper, lower)
        return float(np.min(np.divide(ends - at, way, out=np.full(len(at), np.inf), where=way != 0)))

    def prior_residuals(self, coordinates: Floats) -> Floats:
        """(m,) standard normal variables of the priors."""
        return self.prior_rows @ (coordinates - self.prior_centre)

    def prior_deviance(self, coordinates: Floats) -> float:
        """Minus twice the logarithm of the priors' density, up to a constant."""
        return float(np.sum(self.prior_residuals(coordinates) ** 2))

    def _prior(self) -> tuple[Floats, Floats]:
        p = len(self._unknowns)
        centre, rows, wave_indices = np.zeros(p), [], set[int]()
        for amplitude, angle in self.waves:
            size, at = self._unknowns[amplitude].prior, self._unknowns[angle].prior
            if size and at:
                mean, covariance = _parts(size, at)
                both, by = [amplitude, angle], self._scale[amplitude]
                centre[both] = mean / by
                row = np.zeros((2, p))
                row[:, both] = np.linalg.inv(np.linalg.cholesky(covariance / by**2))
                rows.append(row)
                wave_indices |= set(both)
        for index, unknown in enumerate(self._unknowns):
            if unknown.prior and index not in wave_indices:
                row = np.zeros((1, p))
                row[0, index] = self._scale[index] / unknown.prior.deviation
                centre[index] = unknown.prior.mean / self._scale[index]
                rows.append(row)
        return np.concatenate(rows) if rows else np.zeros((0, p)), centre


def _waves(unknowns: Sequence[UnknownParameter]) -> tuple[tuple[int, int], ...]:
    """Indices of amplitude and angle of every wave for which both are unknown, and both or none have a prior."""
    index = {unknown.key: number for number, unknown in enumerate(unknowns)}
    waves = []
    for key, number in index.items():
        for angle, amplitude in WAVES.items():
            other = index.get(key.removesuffix(angle) + amplitude)
            if not key.endswith(f".{angle}") or other is None:
                continue
            if bool(unknowns[other].prior) == bool(unknowns[number].prior):
                waves.append((other, number))
    return tuple(waves)


def _parts(size: Prior, at: Prior) -> tuple[Floats, Floats]:
    """Mean and covariance of the parts of a wave with normally distributed amplitude and angle."""
    once, twice, square = np.exp(-(at.deviation**2) / 2), np.exp(-2 * at.deviation**2), size.mean**2 + size.deviation**2
    mean = size.mean * once * np.array([np.cos(at.mean), np.sin(at.mean)])
    cosine, sine = twice * np.cos(2 * at.mean), twice * np.sin(2 * at.mean)
    squares = square / 2 * np.array([[1 + cosine, sine], [sine, 1 - cosine]])
    return mean, squares - np.outer(mean, mean)
