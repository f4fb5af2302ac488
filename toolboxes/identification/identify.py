"""Estimate a machine's parameters from logs in one call."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Ensemble,
    Experiment,
    Result,
    arguments,
    executors,
    progresses,
    with_leaves,
)
from dualwinch.toolboxes.identification.alternatives import StartUnderWay, UndescribedSea, selected
from dualwinch.toolboxes.identification.diagnostics import (
    check_fit,
    check_log,
    likelihood_profiles,
    rms_innovations,
    sandwich_factors,
    unidentifiable_directions,
    whiteness_tests,
)
from dualwinch.toolboxes.identification.estimate import (
    ParameterEstimate,
    distinct_optima,
    multistart,
    with_data_sheets,
)
from dualwinch.toolboxes.identification.log import Log, column_map, gap_note, log_of, read_log
from dualwinch.toolboxes.identification.models import FittedModel, marginal
from dualwinch.toolboxes.identification.options import DEFAULTS, EstimationOptions
from dualwinch.toolboxes.identification.predictor import READINGS
from dualwinch.toolboxes.identification.resample import LogSection, counting, sections_of
from dualwinch.toolboxes.identification.result import IdentificationResult
from dualwinch.toolboxes.identification.screening import LogScreening
from dualwinch.toolboxes.identification.selection import ModelSelection
from dualwinch.toolboxes.identification.smoother import smoothed_force
from dualwinch.toolboxes.identification.unknowns import (
    Prior,
    covariance_of,
    estimable_keys,
    problem_of,
    unknown_parameters,
)
from dualwinch.toolboxes.identification.vortices import with_vortex_origin

Floats = NDArray[np.float64]

GAS_DENSITY = 100.0
"""Density in kg/m³ below which a medium is a gas."""

Source = Log | Result | str | PathLike[str]


def identify(
    logs: Source | Sequence[Source],
    keys: str | Sequence[str],
    experiment: Experiment | None = None,
    *,
    ensemble: str | PathLike[str] | Ensemble | None = None,
    priors: Mapping[str, Prior | tuple[float, float]] | None = None,
    columns: Sequence[str] | Mapping[str, str] = (),
    csv: str = "",
    hold_out: float = 0.0,
    starts: int = 1,
    seed: int = 0,
    profiles: str | Sequence[str] = (),
    forces: bool = False,
    unrecorded: float | None = None,
    plain: bool = False,
    alternatives: str | Sequence[str] = (),
    options: EstimationOptions = DEFAULTS,
    workers: executors.Workers = None,
    progress: progresses.PhaseProgress = progresses.no_progress,
) -> IdentificationResult:
    """Estimate `keys` by maximum likelihood of the innovations of an extended Kalman filter (prediction-error method).

    1. Logged torques drive the plant; the filter predicts position, speed, tensions and drum angles one sample ahead.
       Its state is augmented by unrecorded disturbances.
    2. Parameters, measurement noise R and process noise Q maximise the likelihood
       (`identification.estimate.PredictionErrorMethod`).
    3. The curvature of the likelihood gives standard deviations and correlations; tests of the innovations show whether
       the model is incomplete.

    Args:
        logs: of one machine, each with its own initial state: files (CSV, Parquet, MATLAB, NumPy), results with
            ``simulation.readings``, or `Log`.
        keys: parameters to estimate, such as ``plant.vehicle.mass`` or ``plant.rope_*.modulus``.
        experiment: values of all other parameters, and start of the search; default: the ensemble's, or
            ``Experiment()``.
        ensemble: name or file of an ensemble, such as ``rig``: every parameter that it draws and a log determines is
            estimated as well, with its distribution as a prior.
        priors: key → mean and standard deviation of a normal prior.
        columns: of files, if they have other names or units: ``{"F1": "load_cell_left:kN"}``, or texts as of the
            command line, ``F1=load_cell_left:kN``.
        csv: separator and decimal mark of CSV files, such as ``;,``; default: detected in each file.
        hold_out: share at the end of each log that is predicted, not fitted.
        starts: number of searches from different starts; all but the first are drawn.
        seed: of these draws.
        profiles: estimated parameters for which to compute profile likelihoods.
        forces: whether to estimate the unrecorded force on the vehicle: `forces` of the result, for
            ``disturbance.force``. It includes any sea; vortices are as described.
        unrecorded: ratio of unrecorded to recorded RMS torque or force above which a fit is refused: the log is of
            another machine, or the model is incomplete; default: ``options.plausibility.max_unrecorded``. Where it is
            given, improbable nuisance parameters are accepted, too.
        plain: whether to fit the experiment as described only, without alternatives: quick, and right where innovations
            are white and rows are at the controller's samples.
        alternatives: names of the alternatives that are compared with the experiment as described
            (`identification.alternatives.ALTERNATIVES`), such as ``"sea, load-cell-lag"`` or ``"all, -sea"``; default:
            all, also those that you registered.
        options: of the method.
        workers: number of threads of this machine, or an executor; default: one thread per core.
        progress: called repeatedly with the share of the work that is done, which never falls.

    Returns:
        Estimates with deviations and correlations, unidentifiable directions, and tests of the innovations. It has a
        table as text and in a notebook; its `experiment` and `ensemble` have the estimates.

    Raises:
        ConfigurationError: a file that cannot be read, a key or prior out of range, or a log that is implausible for
            such a machine.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first fit; afterwards the result has what was compared until then.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 2.0, "sensors.tension_noise": 5.0})
        >>> run = dw.override(run, {"simulation.readings": True})
        >>> fit = dw.identify(dw.simulate(run), "plant.vehicle.mass", run)
        >>> bool(abs(fit.values[0] - 1e4) < 4 * fit.deviations[0])
        True
    """
    began = perf_counter()
    if not 0 <= arguments.one_number("hold_out", hold_out) < 1:
        raise ConfigurationError(f"hold_out = {hold_out:g}: must be >= 0 and < 1")
    if unrecorded is not None and not arguments.one_number("unrecorded", unrecorded) > 0:
        raise ConfigurationError(f"unrecorded = {unrecorded:g}: must be > 0")
    arguments.whole_number("starts", starts, 1)
    arguments.whole_number("seed", seed)
    arguments.instance("options", options, EstimationOptions)
    experiment, names, all_priors = problem_of(keys, experiment, ensemble, priors)
    recordings = _logs(logs, columns, csv)  # before all work, so that a wrong file is told at once
    profiled = estimable_keys(arguments.texts("profiles", profiles), experiment, "--profile")
    if extras := [key for key in profiled if key not in names]:
        raise ConfigurationError(f"--profile {extras[0]}: is not fitted; add it to --fit")
    unknowns = unknown_parameters(names, experiment, all_priors, options.search)
    kinds = selected(arguments.texts("alternatives", alternatives))
    kinds = kinds - {UndescribedSea.kind} if forces or _in_gas(experiment) else kinds
    recordings, parts, split = _parts(recordings, experiment, options, kinds if not plain else (), hold_out)
    forward = _Forward(progress)
    screening = LogScreening([log for log, _ in split], experiment, unknowns, executors.threads_of(workers), kinds)
    sections = sections_of(screening.logs, experiment, options.resampling)
    plausible = partial(check_fit, sections=sections, experiment=experiment, options=options, unrecorded=unrecorded)
    check = partial(_checked_fit, plausible=plausible, accepted=unrecorded is not None)
    selection = ModelSelection(screening, options, check, _Forward(forward, 1 / starts))
    model = selection.of(experiment, plain=plain)
    method, n = model.method, len(unknowns)
    estimates = [*multistart(method, model.estimate, n, starts, seed, forward, workers), *model.optima]
    estimates = sorted(estimates, key=lambda each: each.deviance)
    excess, recorded = plausible(estimates[0]), {name for log in recordings for name in log.readings}
    alone, calibrated = estimates[0], model.white
    method, best = with_data_sheets(method, alone, recorded, calibrated=calibrated)
    fitted, diagnostics = method.filters.sections, options.diagnostics
    innovations = method.filters.whitened_innovations(best.experiment, best.noise)
    end_sections = sections_of([log for _, log in split if log], model.experiment, method.options.resampling)
    held_out = method.filters_of(end_sections).whitened_innovations(best.experiment, best.noise) if end_sections else []
    information = marginal(best.information, method.unknowns, n)
    whiteness = whiteness_tests(innovations, [section.torques for section in fitted], diagnostics)
    beside_encoders = [test for test in whiteness if test.name not in counting(experiment.sensors)]
    white = all(test.white for test in beside_encoders or whiteness)
    wider = np.ones(len(method.unknowns))
    if not (white and calibrated):
        own = (method, best) if calibrated else (model.method, alone)
        wider[: len(own[1].values)] = sandwich_factors(*own)
    perfect = covariance_of(marginal(alone.information, model.method.unknowns, n), unknowns)
    by_sheets = covariance_of(information, unknowns) - perfect
    spread = perfect * np.outer(wider[:n], wider[:n]) + by_sheets
    values, covariance = model.averaged(best.values[:n], spread, by_sheets)
    by_key = replace(model, method=method, estimate=best).along(n, wider)
    sheet_keys = {each.key for each in method.unknowns[len(model.method.unknowns) :]}
    return IdentificationResult(
        experiment=with_leaves(
            experiment,
            {key: pair[0] for key, pair in by_key.items() if key not in sheet_keys and not key.startswith("recorder.")}
            | dict(zip(names, values.tolist(), strict=True)),
        ),
        unknowns=unknowns,
        values=values,
        covariance=covariance,
        unidentifiable=unidentifiable_directions(information, unknowns, diagnostics),
        noise=_sensor_noise(fitted, best),
        process_noise=best.noise.process_of(best.experiment.plant.vehicle),
        whiteness=whiteness,
        held_out=whiteness_tests(held_out, [section.torques for section in end_sections], diagnostics),
        innovations=rms_innovations(innovations, model.experiment.simulation.sample_time, options.resampling.window),
        logs=tuple(log.name for each in parts for log in each),
        duration=sum(log.duration for each in parts for log in each),
        passes=method.passes,
        converged=best.converged,
        optima=distinct_optima(
            [
                replace(alone, values=best.values[:n]),
                *(replace(each, values=each.values[:n]) for each in estimates[1:]),
            ],
            covariance,
        ),
        seconds=perf_counter() - began,
        options=options,
        profiles=likelihood_profiles(method, best, profiled, workers),
        forces=tuple(smoothed_force(method, log, best) for each in parts for log in each) if forces else (),
        excess=(
            *(note for log in recordings for note in log.notes),
            *(gap_note(each) for each in parts if len(each) > 1),
            *model.notes(experiment),
            *excess,
        ),
        along={key: pair for key, pair in by_key.items() if key not in sheet_keys},
        data_sheet={key: pair for key, pair in by_key.items() if key in sheet_keys},
        sheet_shares=np.clip(1 - np.diag(perfect) / np.diag(perfect + by_sheets), 0.0, 1.0),
        widened=float(wider[:n].max(initial=1.0)),
        models=selection.evidence(model),
        interrupted=selection.interrupted,
    )


def _checked_fit(
    fit: FittedModel, plausible: Callable[[ParameterEstimate], Sequence[str]], *, accepted: bool
) -> Sequence[str]:
    """What `plausible` says of a fit; improbable nuisance parameters are refused unless that is `accepted`."""
    remarks = plausible(fit.estimate)
    if not accepted:
        fit.check_priors()
    return remarks


def _parts(
    logs: Sequence[Log], experiment: Experiment, options: EstimationOptions, kinds: Collection[str], hold_out: float
) -> tuple[list[Log], list[list[Log]], Sequence[tuple[Log, Log | None]]]:
    """Checked logs; each between its gaps; and the beginning and the end, held out, of each of these parts."""
    logs = _checked_logs(logs, experiment, options)
    if StartUnderWay.kind in kinds:
        logs = [with_vortex_origin(log, experiment, options) for log in logs]
    parts = [log.between_gaps(options.resampling.max_gap, options.resampling.min_rows) for log in logs]
    pieces = [part for each in parts for part in each]
    split = [log.split(hold_out) for log in pieces] if hold_out else [(log, None) for log in pieces]
    sections_of([end for _, end in split if end], experiment, options.resampling)  # refused before the fit
    return logs, parts, split


def _in_gas(experiment: Experiment) -> bool:
    """Whether the vehicle moves in a gas, which has no sea."""
    return experiment.plant.vehicle.water_density < GAS_DENSITY


class _Forward:
    """A progress that never goes back, where searches that were not foreseen begin."""

    def __init__(self, progress: progresses.PhaseProgress, whole: float = 1.0) -> None:
        """Pass on to `progress`; the `whole` work is that share of its."""
        self._progress, self._whole, self._share = progress, whole, 0.0

    def __call__(self, fraction: float, phase: str = "", status: str = "") -> None:
        self._share = max(self._share, fraction * self._whole)
        self._progress(self._share, phase, status)


def _logs(logs: Source | Sequence[Source], columns: Sequence[str] | Mapping[str, str], csv: str) -> list[Log]:
    """The logs of sources; where columns are a mapping, messages name them as such."""
    if isinstance(columns, Mapping):
        try:
            return _logs(logs, [f"{reading}={column}" for reading, column in columns.items()], csv)
        except ConfigurationError as error:
            option = r"--column '?(\w+)=([^';,)]+?)'?(?=[;,)\s]|$)"
            words = re.sub(option, lambda parts: f"columns={{{parts[1]!r}: {parts[2]!r}}}", str(error))
            raise ConfigurationError(words) from None
    one = isinstance(logs, (Log, Result, str, PathLike))
    sources = [logs] if one else list(logs) if isinstance(logs, Sequence) else [logs]
    for source in sources:
        arguments.instance("logs", source, Log, Result, PathLike, str)
    if not sources:
        raise ConfigurationError("logs: must be at least one")
    _check_different(sources)
    named = column_map(arguments.texts("columns", columns))
    return [
        source
        if isinstance(source, Log)
        else log_of(source)
        if isinstance(source, Result)
        else read_log(source, named, csv)
        for source in sources
    ]


def _checked_logs(logs: Sequence[Log], experiment: Experiment, options: EstimationOptions) -> list[Log]:
    """Plausible logs, with times from their first rows on."""
    for log in logs:
        check_log(log, experiment, options.plausibility)
    return [log.from_zero() for log in logs]


def _check_different(sources: Sequence[Source]) -> None:
    """Raise `ConfigurationError` for a log given twice, which would count as two."""
    files = [Path(source).resolve() if isinstance(source, (str, PathLike)) else source for source in sources]
    for index, file in enumerate(files):
        if any(file is other or (isinstance(file, Path) and file == other) for other in files[:index]):
            raise ConfigurationError(f"{sources[index] if isinstance(file, Path) else 'logs'}: must be given once")


def _sensor_noise(sections: Sequence[LogSection], estimate: ParameterEstimate) -> dict[str, float]:
    """Standard deviation of the noise of every recorded sensor."""
    read = np.any([np.isfinite(section.readings).any(axis=0) for section in sections], axis=0)
    deviations = np.sqrt(estimate.noise.measurement).tolist()
    return {name: deviation for name, deviation, here in zip(READINGS, deviations, read, strict=True) if here}
