"""Quick looks at logs before a fit: delays of torques, clocks of recorders, other vortices, a lag of load cells.

They show which alternatives are worth a fit, and their most likely form.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import ConfigurationError, Experiment, leaves, physics, with_leaves
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.log import SAME_TIME, Log
from dualwinch.toolboxes.identification.models import FittedModel, LogModel
from dualwinch.toolboxes.identification.noise import LOAD_CELLS
from dualwinch.toolboxes.identification.options import EstimationOptions
from dualwinch.toolboxes.identification.predictor import (
    READINGS,
    NoiseCovariances,
    RecordedExperiment,
    RecorderClock,
    predictor_structure,
    recorded,
)
from dualwinch.toolboxes.identification.resample import LogSection, delays_of, sections_of
from dualwinch.toolboxes.identification.unknowns import UnknownParameter, with_drum_friction, with_load_cell_lag
from dualwinch.toolboxes.identification.vortices import likelier_phase, shows_other_vortices

Floats = NDArray[np.float64]

PHASES = (np.arange(8) / 8 + 1 / 16).tolist()
"""Phases of a recorder at which a search begins, in samples."""

ONE_STEP = "adaptive"
"""Integrator that takes one step from sample to sample."""


def delayed(experiment: Experiment, samples: int) -> Experiment:
    """An experiment with torques that act some samples after they are logged."""
    return replace(experiment, simulation=replace(experiment.simulation, delay_samples=samples))


def ropes_of(experiment: Experiment) -> dict[str, float]:
    """Weight and mass of both ropes per metre, by key."""
    values = leaves(experiment)
    keys = [f"plant.rope_{side}.{name}" for side in (1, 2) for name in ("submerged_weight", "mass_per_length")]
    return {key: values[key] for key in keys}


def lighter_ropes(experiment: Experiment, keys: Collection[str]) -> list[Experiment]:
    """An experiment, then without weight of its ropes, and without weight and mass, as far as they have any.

    Only the experiment where `keys` that are estimated are among these.
    """
    values = ropes_of(experiment)
    if values.keys() & set(keys):
        return [experiment]
    weightless = {key: 0.0 if key.endswith("weight") else value for key, value in values.items()}
    forms = [experiment, with_leaves(experiment, weightless), with_leaves(experiment, dict.fromkeys(values, 0.0))]
    return list(dict.fromkeys(forms))


@dataclass(frozen=True)
class LogScreening:
    """Quick looks at logs of one machine.

    Attributes:
        logs: of the machine.
        described: the experiment as described.
        unknowns: the requested parameters.
        threads: default: one per core.
        kinds: of the alternatives that are allowed (`alternatives.Alternative`).
    """

    logs: Sequence[Log]
    described: Experiment
    unknowns: Sequence[UnknownParameter]
    threads: int | None
    kinds: frozenset[str]
    _deviances: dict[tuple[Experiment, EstimationOptions, bytes], float] = field(default_factory=dict, repr=False)

    def deviance_at_start(
        self, experiment: Experiment, options: EstimationOptions, values: Floats | None = None
    ) -> float:
        """Deviance of an experiment with drum friction at given values of the unknowns, by default their starts.

        Q is from a rough search.
        """
        point = self._starts() if values is None else values
        key = experiment, options, point.tobytes()
        if key not in self._deviances:
            self._deviances[key] = self._with_friction(experiment, options, self.unknowns).deviance(point)
        return self._deviances[key]

    def _starts(self) -> Floats:
        return np.array([each.start for each in self.unknowns])

    def _method(
        self, experiment: Experiment, options: EstimationOptions, unknowns: Sequence[UnknownParameter] = ()
    ) -> PredictionErrorMethod:
        sections = sections_of(self.logs, experiment, options.resampling)
        return PredictionErrorMethod(sections, experiment, unknowns, options, self.threads)

    def _with_friction(
        self, experiment: Experiment, options: EstimationOptions, unknowns: Sequence[UnknownParameter] = ()
    ) -> PredictionErrorMethod:
        return self._method(with_drum_friction(experiment, options.search), options, unknowns)

    def likeliest_at_start(
        self, experiment: Experiment, options: EstimationOptions, values: Floats | None = None
    ) -> tuple[float, Experiment]:
        """The least deviance over all delays of the torques, and the experiment with it; values as above."""
        start = self._starts() if values is None else values
        experiments = [delayed(experiment, samples) for samples in range(options.search.max_delay_samples + 1)]
        methods = [self._with_friction(each, options, self.unknowns) for each in experiments]
        place, deviances = likeliest_in_turn(methods, start, min(experiment.simulation.delay_samples, len(methods) - 1))
        return deviances[place], experiments[place]

    def deviances_with(
        self, noise: NoiseCovariances, experiments: Sequence[Experiment], options: EstimationOptions
    ) -> list[float]:
        """Deviance of each of several experiments with the same noise; infinite if filters diverge."""
        return [self._method(each, options).deviance(np.zeros(0), noise) for each in experiments]

    def likeliest_ropes(
        self, experiment: Experiment, options: EstimationOptions, noise: NoiseCovariances | None = None
    ) -> Experiment:
        """The experiment with its ropes or with lighter ones (`lighter_ropes`), whichever is clearly likelier.

        All with the same noise; default: with that at which the likeliest is likeliest (`likeliest_in_turn`).
        """
        forms = lighter_ropes(experiment, [each.key for each in self.unknowns])
        if len(forms) == 1:
            return experiment
        methods = [self._with_friction(each, options) for each in forms]
        if noise:
            deviances = [each.deviance(np.zeros(0), noise) for each in methods]
            likeliest = int(np.argmin(deviances))
        else:
            likeliest, deviances = likeliest_in_turn(methods, np.zeros(0), len(methods) - 1)
        return forms[likeliest] if deviances[likeliest] + options.search.considerable < deviances[0] else experiment

    def lags(self, experiment: Experiment, options: EstimationOptions) -> Floats:
        """Significance of each delay of the torques (`torque_lags`)."""
        sections = sections_of(self.logs, delayed(experiment, 0), options.resampling)
        return torque_lags(sections, 2 * options.search.max_delay_samples)

    def delay_in(self, experiment: Experiment, options: EstimationOptions) -> int:
        """The delay of the torques in samples, if load cells determine it clearly; else the experiment's."""
        search, significance = options.search, self.lags(experiment, options)
        delay = int(np.argmax(significance[: search.max_delay_samples + 1]))
        described = experiment.simulation.delay_samples
        clear = described >= len(significance) or (
            significance[delay] > search.delay_significance * significance[described]
        )
        return delay if clear else described

    def coarse_options(self, experiment: Experiment, options: EstimationOptions) -> EstimationOptions | None:
        """Options for torques that change between rows (`CoarseLogOptions`); ``None``: rows are at every sample."""
        coarse, step = options.search.coarse, experiment.simulation.sample_time
        if all(np.median(np.diff(log.t)) < coarse.min_spacing * step for log in self.logs):
            return None
        noise = replace(
            options.noise,
            torque_time=coarse.chatter_time * step,
            min_chatter=coarse.min_chatter,
            whole_range=True,
        )
        resampling = replace(options.resampling, between_rows=True)
        return replace(options, resampling=resampling, noise=noise)

    def with_torques_between_rows(self, model: LogModel, values: Floats | None = None) -> LogModel | None:
        """A model with mean torques between rows, if that is likelier at values as above; ``None``: it is not.

        Raises:
            ConfigurationError: rows are too far apart for that (`check_spacing`).
        """
        coarse, kind = self.coarse_options(model.experiment, model.options), "torques-between-rows"
        if coarse is None or kind not in self.kinds or kind in model.kinds:
            return None
        least, delayed = self.likeliest_at_start(model.experiment, coarse, values)
        if least >= self.deviance_at_start(model.experiment, model.options, values):
            return None
        self.check_spacing(model.experiment)
        return replace(model.extended(kind, delayed), options=coarse)

    def likeliest_clock(
        self, experiment: Experiment, options: EstimationOptions, *, interpolated: Sequence[bool] = (False, True)
    ) -> RecordedExperiment | None:
        """The likeliest recorder with a clock of its own, and delay of the torques, at the start.

        1. Candidates are measured and interpolated rows (`predictor.RecorderClock`), each with each delay and phase;
           their likelihoods are those of the start of the logs.
        2. ``None`` where rows at the samples are likelier, by their Bayesian information criteria (one parameter less);
           also for torques that are not logged in every sample, for sensors with delays, and for ropes with mass, whose
           motion between samples takes many steps.
        """
        step, simulation = experiment.simulation.sample_time, experiment.simulation
        spacings = [float(np.median(np.diff(log.t))) for log in self.logs]
        structure = predictor_structure(experiment)
        if (
            not interpolated
            or simulation.jitter
            or any(delays_of(experiment.sensors).values())
            or max(spacings) >= options.search.coarse.min_spacing * step
            or structure.integrator != ONE_STEP
        ):
            return None
        start = np.zeros(0)
        samples, steps = round(options.noise.section_time / step), math.ceil(step / min(spacings) - SAME_TIME)

        def clocked(late: int, phase: float, *, interpolated: bool) -> Experiment:
            recorder = RecorderClock(phase * step, steps=steps, interpolated=interpolated)
            return recorded(delayed(experiment, late), recorder)

        def deviances(candidates: Sequence[Experiment], noise: NoiseCovariances) -> Floats:
            methods = [self._method(each, options) for each in candidates]
            pairs = [
                method.filters.deviances([(method.with_values(start), noise)], samples * steps) for method in methods
            ]
            return np.concatenate(pairs)

        noise = self._method(delayed(experiment, simulation.delay_samples), options).noise_at(start)
        delays = range(options.search.max_delay_samples + 1)
        if "torque-delay" not in self.kinds:
            delays = (simulation.delay_samples,)
        coarse = [(late, phase, kind) for late in delays for phase in PHASES[1::4] for kind in interpolated]
        order = np.argsort(deviances([clocked(*each[:2], interpolated=each[2]) for each in coarse], noise)).tolist()
        likeliest = list(dict.fromkeys((coarse[each][0], coarse[each][2]) for each in order))
        likely = clocked(*coarse[order[0]][:2], interpolated=coarse[order[0]][2])
        noise = self._method(likely, options).noise_at(start)
        fine = [(late, phase, kind) for late, kind in likeliest[:2] for phase in PHASES]
        between = deviances([clocked(*each[:2], interpolated=each[2]) for each in fine], noise)
        late, phase, kind = fine[int(np.argmin(between))]
        if self.at_samples(experiment):
            whole = [delayed(experiment, each) for each in delays]
            readings = sum(np.isfinite(log.columns[name]).sum() for log in self.logs for name in log.readings)
            if between.min() + math.log(readings) >= deviances(whole, noise).min():
                return None
        return recorded(delayed(experiment, late), RecorderClock(phase * step, steps=steps, interpolated=kind))

    def at_samples(self, experiment: Experiment) -> bool:
        """Whether all rows of a log are whole samples apart."""
        times = [(log.t - log.t[0]) / experiment.simulation.sample_time for log in self.logs]
        return all(np.median(np.diff(each)) > 0.9 and np.abs(each - np.rint(each)).max() < 0.1 for each in times)

    def check_spacing(self, experiment: Experiment) -> None:
        """Refuse logs with torques that change between rows, and rows too far apart for the drums' resonance.

        Load cells then alias the resonance, and estimated masses are too large by several standard deviations.
        """
        plant = experiment.plant
        least = min(
            side.winch.drum_radius * math.sqrt(float(side.rope.tangent(1.0, length)[0]) / side.winch.inertia) / math.tau
            for x in (0.0, plant.track.length)
            for side, length in zip(plant.sides, physics.rope_lengths(x, plant.track), strict=True)
        )
        for log in self.logs:
            if (spacing := float(np.median(np.diff(log.t)))) > 1 / (2 * least):
                raise ConfigurationError(
                    f"{log.name}: has a row every {1e3 * spacing:.3g} ms, its torques change in between, and its drums "
                    f"swing on the ropes at {least:.3g} Hz or more: must have a row every {500 / least:.2g} ms or less"
                )

    def load_cell_lag(self, experiment: Experiment, options: EstimationOptions, values: Floats | None) -> float:
        """A lag of the load cells in s with which logs are likelier; 0: there is none.

        Even a lag of a millisecond leaves more torque unexplained than the log of another machine. Likelihoods are
        those at the (p,) values of the requested parameters, by default at their starts.
        """
        recorded_names = {name for log in self.logs for name in log.columns}
        if experiment.sensors.load_cell_time_constant or recorded_names.isdisjoint(LOAD_CELLS):
            return 0.0
        best, least = 0.0, self.deviance_at_start(experiment, options, values)
        lag = experiment.simulation.sample_time / 2
        while lag < options.noise.torque_time:  # a longer one is no different from unrecorded torques
            deviance = self.deviance_at_start(with_load_cell_lag(experiment, lag), options, values)
            if deviance >= least:
                break
            best, least, lag = lag, deviance, 2 * lag
        return best

    def strouhal_reach(self, experiment: Experiment, options: EstimationOptions) -> float:
        """Largest deviation of the Strouhal number from an experiment's."""
        return options.search.reach * options.search.strouhal_share * experiment.disturbance.strouhal

    def integrated_phase(self, experiment: Experiment, options: EstimationOptions) -> bool:
        """Whether logs show vortices with an integrated phase."""
        return likelier_phase(self.logs, experiment, self.strouhal_reach(experiment, options), options)

    def other_vortices(self, fit: FittedModel) -> bool:
        """Whether logs show vortices that an estimate lacks; white innovations do not exclude such slow forces."""
        experiment, options = fit.estimate.experiment, fit.model.options
        return shows_other_vortices(self.logs, experiment, self.strouhal_reach(experiment, options), options)


def likeliest_in_turn(methods: Sequence[PredictionErrorMethod], values: Floats, first: int) -> tuple[int, list[float]]:
    """The likeliest of several models at the same values, and the deviances of all with its noise.

    Model and process noise in turn: from the noise at which the `first` is likeliest to the model that is likeliest
    with that, until a model comes again.
    """
    turns, place = dict[int, list[float]](), first
    while place not in turns:
        noise = methods[place].noise_at(values)
        turns[place] = [each.deviance(values, noise) for each in methods]
        place = int(np.argmin(turns[place]))
    likeliest = min(turns, key=lambda each: turns[each][each])
    return likeliest, turns[likeliest]


def torque_lags(sections: Sequence[LogSection], order: int) -> Floats:
    """(order,) squared t-values of the torques 0, 1, ... samples ago in ARX models of the load cells.

    Each tension is regressed on its own last `order` values, which removes the effect of the loop that commands the
    torques, and on as many past torques. Zeros without usable load cells.
    """
    squares = np.zeros(order)
    for section, side in product(sections, (0, 1)):
        tension, torque = section.readings[:, READINGS.index("F1") + side], section.torques[:, side]
        past = [np.roll(values, lag) for values in (tension, torque) for lag in range(1, order + 1)]
        rows = np.column_stack([*past, tension])[order:]
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) < 10 * order or not rows[:, order].std():
            continue
        rows = (rows - rows.mean(axis=0)) / rows.std(axis=0)
        r = np.asarray(np.linalg.qr(rows, mode="r"))
        inverse = np.linalg.pinv(r[:-1, :-1])
        coefficients = inverse @ r[:-1, -1]
        squares += (coefficients**2 / (inverse**2).sum(axis=1))[order:] / (r[-1, -1] ** 2 / len(rows))
    return squares
