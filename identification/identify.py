"""From logs to a machine in one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.acting import force_of
from dualwinch.identification.blind import blind
from dualwinch.identification.doubts import ANOTHER, check_fit, check_log
from dualwinch.identification.fit import Fit, Fitting, covariance_of
from dualwinch.identification.log import Log
from dualwinch.identification.optima import fits_from, optima_of
from dualwinch.identification.profile import profile_of
from dualwinch.identification.result import Identified
from dualwinch.identification.sections import Filters, Section, sections_of
from dualwinch.identification.sensed import READINGS
from dualwinch.identification.surprises import Whiteness, whiteness
from dualwinch.identification.unknowns import Prior, keys_of, unknowns_of
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

WINDOWS, LEAST = 200, 50
"""Windows of time that surprises are summed up in, at most, and samples of one, at least."""


def identify(
    logs: Sequence[Log],
    keys: Sequence[str],
    experiment: Experiment,
    *,
    priors: Mapping[str, Prior] | None = None,
    hold_out: float = 0.0,
    starts: int = 1,
    seed: int = 0,
    profiles: Sequence[str] = (),
    forces: bool = False,
    unrecorded: float = ANOTHER,
    threads: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Identified:
    """Find out what some numbers of a machine are from what its sensors said.

    Logged torques drive the plant; position, speed, tensions and drum angles are predicted one sample ahead by an
    extended Kalman filter that knows how the sea acts (the experiment's ``disturbance``) and finds out how noisy the
    sensors are; the numbers are those with which it is surprised least (`identification.fit`).

    Args:
        logs: of one machine, each in a state of its own at its start.
        keys: what to fit, such as ``plant.vehicle.mass`` or ``plant.rope_*.modulus``.
        experiment: what is believed: everything that is not fitted, and where the search begins.
        priors: key → what is known beforehand.
        hold_out: share of each log, its end, that is not fitted but predicted.
        starts: searches from different starts; all but the first are drawn.
        seed: of these draws.
        profiles: some of what is fitted, whose likelihood is followed away from the best.
        forces: whether it is said what acted on the vehicle and nobody recorded.
        unrecorded: torque or force that nobody recorded, over the recorded one, from which on a fit is refused.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError: no log, nothing to fit, a key or prior that cannot be, a log that no such machine can have
            made.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    began = perf_counter()
    if not logs:
        raise ConfigurationError("logs: must be at least one")
    if not 0 <= hold_out < 1:
        raise ConfigurationError(f"hold_out = {hold_out:g}: must be >= 0 and < 1")
    if not unrecorded > 0:
        raise ConfigurationError(f"unrecorded = {unrecorded:g}: must be > 0")
    if starts < 1:
        raise ConfigurationError(f"starts = {starts}: must be >= 1")
    for log in logs:
        check_log(log, experiment)
    names = keys_of(keys, experiment)
    for key in keys_of(profiles, experiment):
        if key not in names:
            raise ConfigurationError(f"--profile {key}: is not fitted; add it to --fit")
    unknowns = unknowns_of(names, experiment, priors or {})
    whole = sections_of(logs, experiment)
    fitted, kept = _parted(logs, experiment, whole, hold_out)
    fitting = Fitting(fitted, experiment, unknowns, threads=threads)
    fits = fits_from(fitting, starts, seed, progress)
    fit = fits[0]
    excess = check_fit(logs[0].name, fit, fitted, experiment, unrecorded)
    filters = fitting.filters
    surprises = _surprises(filters, fit)
    held = _surprises(fitting.others(kept), fit) if kept else []
    covariance = covariance_of(fit.information, unknowns)
    return Identified(
        experiment=fit.experiment,
        unknowns=unknowns,
        values=fit.values,
        covariance=covariance,
        blind=blind(fit.information, unknowns),
        noise=_noise(fitted, fit),
        scatter=dict(fit.levels.scatter),
        tests=_tests(surprises, fitted),
        held_out=_tests(held, kept) if kept else (),
        courses=_courses(surprises, experiment.simulation.sample_time),
        logs=tuple(log.name for log in logs),
        duration=sum(log.duration for log in logs),
        passes=fitting.passes,
        settled=fit.settled,
        optima=optima_of(fits, covariance),
        seconds=perf_counter() - began,
        profiles=tuple(profile_of(fitting, fit, key) for key in keys_of(profiles, experiment)),
        forces=tuple(force_of(fitting, log, fit) for log in logs) if forces else (),
        excess=excess,
    )


def _parted(
    logs: Sequence[Log], experiment: Experiment, whole: tuple[Section, ...], share: float
) -> tuple[tuple[Section, ...], tuple[Section, ...]]:
    """Sections to fit, and sections at the logs' ends to predict."""
    if not share:
        return whole, ()
    ends = [log.t[0] + (1 - share) * (log.t[-1] - log.t[0]) for log in logs]
    early = [_part(log, log.t < end) for log, end in zip(logs, ends, strict=True)]
    late = [_part(log, log.t >= end) for log, end in zip(logs, ends, strict=True)]
    return sections_of(early, experiment), sections_of(late, experiment)


def _part(log: Log, rows: NDArray[np.bool_]) -> Log:
    return replace(log, t=log.t[rows], columns={name: values[rows] for name, values in log.columns.items()})


def _surprises(filters: Filters, fit: Fit) -> list[Floats]:
    """What every reading was beyond what was expected, whitened, (samples, readings) a section."""
    weights = filters.weigh(fit.experiment, fit.levels)
    vector = filters.vector(fit.experiment, fit.levels)
    predictions = filters.predict(vector, fit.experiment, fit.levels, weights, rows=True)
    return [run.innovations for run in predictions if run.innovations is not None]


def _tests(surprises: Sequence[Floats], sections: Sequence[Section]) -> tuple[Whiteness, ...]:
    return whiteness(surprises, [section.torques for section in sections])


def _courses(surprises: Sequence[Floats], step: float) -> dict[str, Floats]:
    """Time and root mean square of whitened surprises in windows, for each sensor that was read."""
    every = np.concatenate(surprises)
    windows = np.array_split(np.arange(len(every)), max(1, min(WINDOWS, len(every) // LEAST)))
    times = np.array([step * window.mean() for window in windows])
    found = {}
    for column, name in enumerate(READINGS):
        values = every[:, column]
        if np.isfinite(values).any():
            squares = [
                float(np.mean(kept**2)) if len(kept := part[np.isfinite(part)]) else np.nan
                for part in (values[window] for window in windows)
            ]
            found[name] = np.array([times, np.sqrt(squares)])
    return found


def _noise(sections: Sequence[Section], fit: Fit) -> dict[str, float]:
    read = np.any([np.isfinite(section.readings).any(axis=0) for section in sections], axis=0)
    deviations = np.sqrt(fit.levels.noise).tolist()
    return {name: deviation for name, deviation, here in zip(READINGS, deviations, read, strict=True) if here}
