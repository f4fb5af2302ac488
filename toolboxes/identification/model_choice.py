"""Model choice for logs: the experiment as described or, if its innovations are coloured, a wider model.

The wider model has nuisance parameters with wide priors, which are estimated too: inertia of the winches, damping of
the ropes, lag of the load cells, Strouhal number, delay of the torques, and a sea that the experiment does not
describe.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import ConfigurationError, Experiment, physics, progresses
from dualwinch.toolboxes.identification.alternatives import (
    ALTERNATIVES,
    INTERPOLATED_ROWS,
    LOAD_CELL_LAG,
    RECORDER_CLOCK,
    SEA,
    TORQUE_DELAY,
    TORQUES_BETWEEN_ROWS,
    VORTEX_PHASE,
    WINCHES_AND_ROPES,
    Alternative,
)
from dualwinch.toolboxes.identification.diagnostics import ImplausibleFitError, UnrecordedForceError, whiteness_tests
from dualwinch.toolboxes.identification.estimate import DivergedFilterError, ParameterEstimate, PredictionErrorMethod
from dualwinch.toolboxes.identification.likelihood import LOAD_CELLS
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.options import EstimationOptions, SearchOptions
from dualwinch.toolboxes.identification.predictor import (
    READINGS,
    NoiseCovariances,
    RecordedExperiment,
    RecorderClock,
    described_disturbances,
    has_vortex_states,
    predictor_structure,
    recorded,
)
from dualwinch.toolboxes.identification.resample import LogSection, counting, delays_of, sections_of
from dualwinch.toolboxes.identification.unknowns import (
    AMPLITUDE,
    STROUHAL,
    UnknownParameter,
    clock_parameters,
    covariance_of,
    nuisance_parameters,
    with_drum_friction,
    with_load_cell_lag,
    with_sea,
)
from dualwinch.toolboxes.identification.vortices import likelier_phase, shows_other_vortices, vortex_starts

Floats = NDArray[np.float64]

PHASES = (np.arange(8) / 8 + 1 / 16).tolist()
"""Phases of a recorder at which a search begins, in samples."""

TOLERANCE = 1e-3
"""Relative error of a recorder's rate, at most."""

NEGLIGIBLE_WEIGHT = 0.01
"""Weight of other models that is not worth a note."""

ONE_STEP = "adaptive"
"""Integrator that takes one step from sample to sample."""


@dataclass(frozen=True)
class FittedModel:
    """A model with its estimate.

    Attributes:
        experiment: with sea and delay of the model.
        method: of the estimate; its unknowns are the requested parameters and, behind them, nuisance parameters.
        estimate: the best one.
        others: estimates from other starts.
        rivals: models that it was compared with, each with the deviance above its own.
    """

    experiment: Experiment
    method: PredictionErrorMethod
    estimate: ParameterEstimate
    others: tuple[ParameterEstimate, ...] = ()
    rivals: "tuple[tuple[float, FittedModel], ...]" = ()

    def notes(self, described: Experiment) -> tuple[str, ...]:
        """Differences of the model from the described experiment, in words."""
        own, given, found = self.experiment, described.disturbance, list[str]()
        if isinstance(own, RecordedExperiment):
            index = [each.key for each in self.method.unknowns].index("recorder.phase")
            deviation = math.sqrt(covariance_of(self.estimate.information, self.method.unknowns)[index, index])
            late = own.simulation.delay_samples * own.simulation.sample_time - self.estimate.values[index]
            found.append(
                "rows are interpolated between the controller's samples"
                if own.recorder.interpolated
                else "rows are between the controller's samples: torques act "
                f"{1e3 * late:.4g} ± {1e3 * deviation:.2g} ms after their row"
            )
        elif (delay := own.simulation.delay_samples) != described.simulation.delay_samples:
            found.append(
                f"torques act {delay} samples after they are logged; simulation.delay_samples = "
                f"{described.simulation.delay_samples} stays as it is"
            )
        lag = self.estimate.experiment.sensors.load_cell_time_constant
        if lag > own.simulation.sample_time / 10 and not described.sensors.load_cell_time_constant:
            found.append(
                f"load cells lag by {1e3 * lag:.2g} ms, which the experiment does not describe "
                f"(sensors.load_cell_time_constant = {lag:.2g})"
            )
        sea = {"vortices (disturbance.vortex)": own.disturbance.vortex and not given.vortex}
        sea["current (current_sigma)"] = own.disturbance.current_sigma > given.current_sigma
        sea["changes of the rail load (normal_force_sigma)"] = (
            own.disturbance.normal_force_sigma > given.normal_force_sigma
        )
        if self.method.options.resampling.torque_rows:
            found.append(
                "torques changed more often than they were logged: between rows their mean over "
                f"{self.method.options.resampling.torque_rows} rows is used, and chatter is treated as noise"
            )
        if names := [name for name, added in sea.items() if added]:
            found.append(f"estimated with {', '.join(names)}, which the experiment does not describe")
        if own.disturbance.vortex and own.disturbance.integrated_phase != given.integrated_phase:
            kind = (
                "is the integral of their frequency"
                if own.disturbance.integrated_phase
                else "follows from speed and time"
            )
            found.append(f"the phase of the vortices {kind} (disturbance.integrated_phase), unlike the experiment's")
        weights = [1.0, *(math.exp(-above / 2) for above, _ in self.rivals)]
        if (share := 1 - 1 / sum(weights)) > NEGLIGIBLE_WEIGHT:
            found.append(
                f"another model is almost as likely (weight {share:.0%}), and estimates and deviations are averages of "
                "both"
            )
        return (*found, *self._sea_of_another_size(described))

    def _sea_of_another_size(self, described: Experiment) -> Iterator[str]:
        """A note on each described disturbance with a clearly different size in the logs."""
        options, vehicle = self.method.options.noise, described.plant.vehicle
        usual, far = described_disturbances(described, options), math.sqrt(options.described_factor)
        names = {
            "current": ("current", 1.0, " m/s"),
            "normal_force_variation": ("normal_force", vehicle.normal_force, ""),
        }
        process = self.estimate.noise.process_of(self.estimate.experiment.plant.vehicle)
        for key, (name, by, unit) in names.items():
            own, given = process[key], usual[key]
            if given.deviation and not 1 / far < own.deviation / given.deviation < far:
                yield (
                    f"disturbance.{name}_sigma = {given.deviation / by:.3g}, {name}_time = {given.time:.3g}: "
                    f"these logs show {own.deviation / by:.2g}{unit} and {own.time:.2g} s"
                )

    def along(self, count: int, wider: Floats) -> dict[str, tuple[float, float]]:
        """Value and standard deviation, times a factor of `wider`, of the unknowns behind the first `count`."""
        unknowns, estimate = self.method.unknowns, self.estimate
        deviations = wider * np.sqrt(np.diag(covariance_of(estimate.information, unknowns)))
        pairs = zip(estimate.values[count:].tolist(), deviations[count:].tolist(), strict=True)
        return {each.key: pair for each, pair in zip(unknowns[count:], pairs, strict=True)}

    def averaged(self, values: Floats, covariance: Floats, by_sheets: Floats) -> tuple[Floats, Floats]:
        """(n,) values and (n, n) covariance of the first unknowns, averaged over this model and its rivals.

        A part of the covariance is by data sheets, and the same for all of them. Each is weighted by its likelihood, so
        that the average does not hang on which of two close models is chosen (Burnham and Anderson, Model Selection and
        Multimodel Inference, 2002, Section 4.3).
        """
        n, weights = len(values), [1.0, *(math.exp(-above / 2) for above, _ in self.rivals)]
        means, spreads = [values], [covariance]
        for _, rival in self.rivals:
            information = marginal(rival.estimate.information, rival.method.unknowns, n)
            means.append(rival.estimate.values[:n])
            spreads.append(covariance_of(information, rival.method.unknowns[:n]) + by_sheets)
        mean = np.average(means, axis=0, weights=weights)
        around = [spread + np.outer(each - mean, each - mean) for each, spread in zip(means, spreads, strict=True)]
        return mean, np.average(around, axis=0, weights=weights)

    def contradicts(self, key: str, most: float) -> bool:
        """Whether the logs contradict the prior of an unknown: at a bound, or off by `most` expected deviations."""
        index = {each.key: number for number, each in enumerate(self.method.unknowns)}.get(key)
        if index is None or not (unknown := self.method.unknowns[index]).prior:
            return False
        left = covariance_of(self.estimate.information, self.method.unknowns)[index, index]
        off, value = self.estimate.values[index] - unknown.prior.mean, self.estimate.values[index]
        expected = math.sqrt(max(unknown.prior.deviation**2 - left, 0.0))
        return not unknown.lower < value < unknown.upper or abs(off) > most * expected

    @property
    def mean_deviance(self) -> float:
        """Deviance per sample, comparable between delays of the torques, which have different numbers of samples."""
        return self.estimate.deviance / self.method.samples

    @property
    def finished(self) -> bool:
        """Whether all searches for it went on to Newton steps."""
        return all(each.finished for each in (self.estimate, *self.others))

    @property
    def white(self) -> bool:
        """Whether innovations are white (`are_white`)."""
        return are_white(self.method, self.estimate.experiment, self.estimate.noise)


def is_coloured(method: PredictionErrorMethod, experiment: Experiment, noise: NoiseCovariances, _rough: float) -> bool:
    """Whether innovations are not white (`are_white`)."""
    return not are_white(method, experiment, noise)


def are_white(method: PredictionErrorMethod, experiment: Experiment, noise: NoiseCovariances) -> bool:
    """Whether innovations are white, except those of sensors that count in steps."""
    innovations = method.filters.whitened_innovations(experiment, noise)
    torques = [section.torques for section in method.filters.sections]
    tests = whiteness_tests(innovations, torques, method.options.diagnostics)
    return all(test.white for test in tests if test.name not in counting(experiment.sensors))


@dataclass(frozen=True)
class ModelChoice:
    """Chooses the model for logs.

    1. If torques were logged only every few samples, choose the likelier at the start of two models: torques held from
       row to row, or torques that change in between (`CoarseLogOptions`), the latter with each delay.
    2. Choose the described experiment if its innovations are white and smoothed readings show no other vortices (slow
       forces leave innovations white), or if nuisance parameters are switched off.
    3. Take the delay of torques logged in every sample from ARX models of the load cells (`torque_lags`) or, if these
       do not determine it clearly, from the likeliest fit (`_with_likelier_delay`).
    4. Candidates are the experiment with drum friction (`unknowns.with_drum_friction`) and, if it describes no complete
       sea, also with one (`unknowns.with_sea`), each with `unknowns.nuisance_parameters`. The search restarts, because
       the optimum of a model without them is a poor start.
    5. If the Strouhal number is unknown, search from each likely value (`vortices.vortex_starts`); the optima are
       reported.
    6. Choose the likeliest candidate, or the described experiment if that is likelier still, by the sum of a model's
       deviances with the noise of every model: noise of sensors and torques that is not quite at its maximum changes
       the likelihood by more than a sea does.
    7. The kind of the vortices' phase follows from smoothed readings (`vortices.likelier_phase`); if the amplitude of
       the paper's kind is far from the described one, the other kind is tried.
    8. If all this ends in a refusal or in coloured innovations, and no lag of the load cells is described: double one
       as long as the logs are likelier with it, and choose anew with the lag, unless another delay without one is
       likelier.

    All logs are of one machine. The number of threads is by default one per core.
    """

    logs: Sequence[Log]
    unknowns: Sequence[UnknownParameter]
    options: EstimationOptions
    threads: int | None
    progress: progresses.PhaseProgress
    alternatives: frozenset[Alternative] = frozenset(ALTERNATIVES)

    def of(
        self, experiment: Experiment, check: Callable[[ParameterEstimate], Sequence[str]], *, plain: bool = False
    ) -> FittedModel:
        """Choose the model for an experiment as described.

        Without a sea among the alternatives all unrecorded forces are combined, and vortices are as described. A
        `plain` choice is the described experiment, whatever its innovations.

        `check` refuses an implausible estimate, or returns notes on it (`diagnostics.check_fit`). Only another delay
        can improve such an estimate, or a sea if a force is missing.

        Raises:
            DivergedFilterError: the filter diverges with every model.
            ConfigurationError: the estimate is refused, or a parameter without a prior has no effect at all.
        """
        sea = SEA in self.alternatives
        if plain or not self.alternatives:
            model = self._fitted(experiment, self.unknowns, "fitting", (0.0, 1.0))
            check(model.estimate)
            return model
        if clocked := self.likeliest_clock(experiment):
            if not self._at_samples(experiment):
                return self.with_torques_as_they_are(experiment, clocked, check, sea=sea)
            with suppress(DivergedFilterError, ImplausibleFitError):  # else it makes up for something else
                model = self._fitted(clocked, self.unknowns, "fitting", (0.0, 0.4), unless=is_coloured)
                check(model.estimate)
                if model.white and model.finished:
                    return model
        chosen, coarse = self.with_likeliest_torques(experiment)
        return chosen.with_torques_as_they_are(experiment, coarse, check, sea=sea)

    def with_torques_as_they_are(
        self,
        experiment: Experiment,
        coarse: Experiment | None,
        check: Callable[[ParameterEstimate], Sequence[str]],
        *,
        sea: bool,
    ) -> FittedModel:
        """Choose the model as `of`, with the result of `with_likeliest_torques`.

        Where no model without a lag of the load cells is accepted and has white innovations, one with a lag is tried.
        """
        found, refusal, search = None, None, self.options.search
        try:
            found = self._with_load_cells_as_they_are(experiment, coarse, check, sea=sea)
        except (DivergedFilterError, ImplausibleFitError) as error:
            refusal = error
        lag = LOAD_CELL_LAG in self.alternatives and search.nuisance_share
        if not coarse and lag and not (found and found.white):
            lagged = self._with_load_cell_lag(found.experiment if found else experiment, found)
            if lagged.sensors != experiment.sensors:
                with suppress(ConfigurationError):
                    other = self._with_load_cells_as_they_are(lagged, None, check, sea=sea)
                    least = found.mean_deviance - search.min_deviance_fall / found.method.samples if found else math.inf
                    found = other if other.mean_deviance < least else found
        if found is None:
            raise refusal or AssertionError
        return found

    def _with_load_cells_as_they_are(
        self,
        experiment: Experiment,
        coarse: Experiment | None,
        check: Callable[[ParameterEstimate], Sequence[str]],
        *,
        sea: bool,
    ) -> FittedModel:
        """Choose the model as `with_torques_as_they_are`, with the described lag of the load cells."""
        search, plain, notes, refusal = self.options.search, None, (), None
        roughly = partial(self._fitted, coarse or experiment, self.unknowns, "fitting", (0.0, 0.4))
        try:
            plain = roughly(unless=is_coloured if search.nuisance_share else None)
            notes = check(plain.estimate)
        except ConfigurationError as error:
            refusal = error
            if plain is None and not isinstance(error, DivergedFilterError):
                raise
        sound = plain if not refusal else None
        white = bool(sound and sound.white)
        only = WINCHES_AND_ROPES not in self.alternatives and not sea
        if sound and (not search.nuisance_share or only or (white and not (sea and self._other_vortices(sound)))):
            return sound if sound.finished else roughly()
        delayed = coarse or (experiment if white else self._with_delay(experiment))
        if plain and not coarse and delayed == experiment:
            if (
                refusal
                and not isinstance(refusal, UnrecordedForceError)
                and self.likeliest_at_start(experiment)[1] == experiment
            ):
                raise refusal
            if notes:
                return roughly()
        rubbing = with_drum_friction(delayed, search)
        candidates = list(dict.fromkeys((rubbing, self._with_sea(rubbing) if sea else rubbing)))
        lead = search.min_deviance_fall if white else 0.0
        found = self._likeliest(candidates, [sound] if sound else [], lead) or plain
        as_described = bool(plain and found and found.estimate is plain.estimate)
        if found and not as_described and sea:
            found = self._with_likelier_phase(found)
        if found is None or (as_described and refusal):
            raise refusal or AssertionError
        if as_described:
            return found if found.finished else replace(roughly(), rivals=found.rivals)
        return found if coarse else self._with_likelier_delay(found)

    def _with_likelier_phase(self, model: FittedModel) -> FittedModel:
        """A model, or the likelier one with an integrated phase of vortices, tried if the amplitude is implausible.

        Weak vortices hardly show in smoothed readings, and with the wrong kind of phase their estimated amplitude is
        almost zero or far too large.
        """
        own, search = model.experiment.disturbance, self.options.search
        share = model.estimate.experiment.disturbance.vortex_amplitude / (own.vortex_amplitude or 1.0)
        if (
            VORTEX_PHASE not in self.alternatives
            or not own.vortex
            or own.integrated_phase
            or search.negligible_amplitude < share < search.contradicting_amplitude
        ):
            return model
        other = replace(model.experiment, disturbance=replace(own, integrated_phase=True))
        compared = self._likeliest([other], [model], 0.0)
        return replace(compared, rivals=(*compared.rivals, *model.rivals)) if compared else model

    def _with_sea(self, experiment: Experiment) -> Experiment:
        """An experiment with a sea, with the kind of the vortices' phase that logs show."""
        sea = with_sea(experiment, self.options.search)
        integrated = likelier_phase(self.logs, sea, self._strouhal_reach(sea), self.options)
        return replace(sea, disturbance=replace(sea.disturbance, integrated_phase=integrated))

    def _other_vortices(self, model: FittedModel) -> bool:
        """Whether logs show vortices that an estimate lacks; white innovations do not exclude such slow forces."""
        own = model.estimate.experiment
        return shows_other_vortices(self.logs, own, self._strouhal_reach(own), self.options)

    def _strouhal_reach(self, experiment: Experiment) -> float:
        """Largest deviation of the Strouhal number from an experiment's."""
        search = self.options.search
        return search.strouhal_reach * search.strouhal_share * experiment.disturbance.strouhal

    def _with_likelier_delay(self, model: FittedModel) -> FittedModel:
        """A model with the delay of the torques changed sample by sample, as long as that is clearly likelier.

        An ARX model does not determine the delay well if drums respond slowly to torques without chatter, and a fit can
        compensate a sample by inertia and damping. If it determines one delay clearly, no other is tried.
        """
        search = self.options.search
        if TORQUE_DELAY not in self.alternatives:
            return model
        lags = self._lags(model.experiment)
        *_, second, first = np.sort(lags).tolist()
        if lags[model.experiment.simulation.delay_samples] == first > search.delay_significance * second:
            return model
        for way in (1, -1):
            moved = False
            while 0 <= (late := model.experiment.simulation.delay_samples + way) <= search.max_delay_samples:
                values, unknowns = model.estimate.values, model.method.unknowns
                vortices = np.array([each.key in (STROUHAL, AMPLITUDE) for each in unknowns])
                starts = [np.where(vortices, values, [each.start for each in unknowns]), values]
                words = f"fitting torques that act {late} samples late"
                delayed, hopeless = _delayed(model.experiment, late), partial(self._hopeless, model)
                try:
                    likelier = self._fitted(delayed, unknowns, words, (0.9, 1.0), starts=starts, unless=hopeless)
                except DivergedFilterError:
                    break
                if likelier.mean_deviance > model.mean_deviance - search.min_deviance_fall / model.method.samples:
                    break
                model, moved = replace(likelier, others=()), True
            if moved:
                break
        return model

    def _hopeless(
        self,
        model: FittedModel,
        method: PredictionErrorMethod,
        _experiment: Experiment,
        _noise: NoiseCovariances,
        rough: float,
    ) -> bool:
        """Whether least squares leave a deviance far above that which they left with a model."""
        above = rough / method.samples - model.estimate.rough / model.method.samples
        return above > self.options.search.max_delay_deviance

    def _lags(self, experiment: Experiment) -> Floats:
        """Significance of each delay of the torques (`torque_lags`)."""
        sections = sections_of(self.logs, _delayed(experiment, 0), self.options.resampling)
        return torque_lags(sections, self.options.search.delay_order)

    def with_likeliest_torques(self, experiment: Experiment) -> "tuple[ModelChoice, Experiment | None]":
        """Choose the model of torques between rows, and their delay, by the likelihood at the start.

        Returns:
            The choice with its options, and the experiment with the delay; ``None`` if torques are held between rows.

        Raises:
            ConfigurationError: torques change between rows that are too far apart.
        """
        coarse, step = self.options.search.coarse, experiment.simulation.sample_time
        if TORQUES_BETWEEN_ROWS not in self.alternatives:
            return self, None
        if all(np.median(np.diff(log.t)) < coarse.min_spacing * step for log in self.logs):
            return self, None
        noise = replace(
            self.options.noise,
            torque_time=coarse.chatter_time * step,
            min_torque=coarse.min_chatter,
            quiet_share=coarse.quiet_share,
            whole_range=True,
        )
        resampling = replace(self.options.resampling, torque_rows=coarse.rows)
        search = replace(self.options.search, process_noise_tolerance=coarse.process_noise_tolerance)
        other = replace(self, options=replace(self.options, resampling=resampling, noise=noise, search=search))
        least, delayed = other.likeliest_at_start(experiment)
        if least >= self.deviance_at_start(experiment):
            return self, None
        self._check_spacing(experiment)
        return other, delayed

    def likeliest_clock(self, experiment: Experiment) -> RecordedExperiment | None:
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
        kinds = [
            kind for kind, each in ((False, RECORDER_CLOCK), (True, INTERPOLATED_ROWS)) if each in self.alternatives
        ]
        if (
            not kinds
            or simulation.jitter
            or any(delays_of(experiment.sensors).values())
            or max(spacings) >= self.options.search.coarse.min_spacing * step
            or structure.integrator != ONE_STEP
        ):
            return None
        start = np.zeros(0)
        samples, steps = round(self.options.noise.section_time / step), math.ceil(step / min(spacings) - TOLERANCE)

        def method_of(described: Experiment) -> PredictionErrorMethod:
            sections = sections_of(self.logs, described, self.options.resampling)
            return PredictionErrorMethod(sections, described, (), self.options, self.threads)

        def clocked(late: int, phase: float, *, interpolated: bool) -> Experiment:
            recorder = RecorderClock(phase * step, steps=steps, interpolated=interpolated)
            return recorded(_delayed(experiment, late), recorder)

        def deviances(candidates: Sequence[Experiment], noise: NoiseCovariances) -> Floats:
            methods = [method_of(each) for each in candidates]
            pairs = [
                method.filters.deviances([(method.with_values(start), noise)], samples * steps) for method in methods
            ]
            return np.concatenate(pairs)

        noise = method_of(_delayed(experiment, simulation.delay_samples)).noise_at(start)
        delays = range(self.options.search.max_delay_samples + 1)
        if TORQUE_DELAY not in self.alternatives:
            delays = (simulation.delay_samples,)
        coarse = [(late, phase, kind) for late in delays for phase in PHASES[1::4] for kind in kinds]
        order = np.argsort(deviances([clocked(*each[:2], interpolated=each[2]) for each in coarse], noise)).tolist()
        likeliest = list(dict.fromkeys((coarse[each][0], coarse[each][2]) for each in order))
        noise = method_of(clocked(*coarse[order[0]][:2], interpolated=coarse[order[0]][2])).noise_at(start)
        fine = [(late, phase, kind) for late, kind in likeliest[:2] for phase in PHASES]
        between = deviances([clocked(*each[:2], interpolated=each[2]) for each in fine], noise)
        late, phase, kind = fine[int(np.argmin(between))]
        if self._at_samples(experiment):
            whole = [_delayed(experiment, each) for each in delays]
            readings = sum(np.isfinite(log.columns[name]).sum() for log in self.logs for name in log.readings)
            if between.min() + math.log(readings) >= deviances(whole, noise).min():
                return None
        return recorded(_delayed(experiment, late), RecorderClock(phase * step, steps=steps, interpolated=kind))

    def _at_samples(self, experiment: Experiment) -> bool:
        """Whether all rows of a log are whole samples apart."""
        times = [(log.t - log.t[0]) / experiment.simulation.sample_time for log in self.logs]
        return all(np.median(np.diff(each)) > 0.9 and np.abs(each - np.rint(each)).max() < 0.1 for each in times)

    def likeliest_at_start(self, experiment: Experiment) -> tuple[float, Experiment]:
        """The least deviance at the start over all delays of the torques, and the experiment with that delay."""
        delayed = [_delayed(experiment, late) for late in range(self.options.search.max_delay_samples + 1)]
        return min(((self.deviance_at_start(each), each) for each in delayed), key=itemgetter(0))

    def _check_spacing(self, experiment: Experiment) -> None:
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

    def deviance_at_start(self, experiment: Experiment, values: Floats | None = None) -> float:
        """Deviance of an experiment with drum friction at given values of the unknowns, by default their starts.

        Q is from a rough search.
        """
        rubbing = with_drum_friction(experiment, self.options.search)
        sections = sections_of(self.logs, rubbing, self.options.resampling)
        method = PredictionErrorMethod(sections, rubbing, self.unknowns, self.options, self.threads)
        return method.deviance(np.array([each.start for each in self.unknowns]) if values is None else values)

    def _with_delay(self, experiment: Experiment) -> Experiment:
        """The experiment with the delay of the torques in the logs, if these determine it clearly."""
        if TORQUE_DELAY not in self.alternatives:
            return experiment
        search, significance = self.options.search, self._lags(experiment)
        delay, described = (
            int(np.argmax(significance[: search.max_delay_samples + 1])),
            experiment.simulation.delay_samples,
        )
        if described < len(significance) and significance[delay] <= search.delay_significance * significance[described]:
            return experiment
        return _delayed(experiment, delay)

    def _with_load_cell_lag(self, experiment: Experiment, fitted: FittedModel | None) -> Experiment:
        """An experiment with a lag of the load cells where it describes none and the logs are likelier with one.

        Even a lag of a millisecond leaves more torque unexplained than the log of another machine. Likelihoods are
        those at the values of the model `fitted` without a lag, if there is one, else at the start.
        """
        values = fitted.estimate.values[: len(self.unknowns)] if fitted else None
        options, recorded = self.options.search, {name for log in self.logs for name in log.columns}
        if experiment.sensors.load_cell_time_constant or recorded.isdisjoint(LOAD_CELLS):
            return experiment
        best, least, lag = experiment, self.deviance_at_start(experiment, values), options.load_cell_lag
        while lag <= options.max_load_cell_lag:
            lagging = with_load_cell_lag(experiment, lag)
            if (deviance := self.deviance_at_start(lagging, values)) >= least:
                break
            best, least, lag = lagging, deviance, 2 * lag
        if best is experiment:
            return experiment
        (lagging, delayed), (punctual, _) = (self.likeliest_at_start(each) for each in (best, experiment))
        return delayed if lagging < punctual else experiment  # a wrong delay looks like a lag

    def _with_nuisances(self, experiment: Experiment, phase: str, shares: tuple[float, float]) -> FittedModel:
        """The estimate with nuisance parameters, with the vortices' amplitude near the described one if possible."""
        search, keys = self.options.search, [unknown.key for unknown in self.unknowns]
        wide = replace(search, amplitude_share=search.wide_amplitude_share)

        def fitted(search: SearchOptions) -> FittedModel:
            nuisances = nuisance_parameters(keys, experiment, search)
            if SEA not in self.alternatives:
                nuisances = tuple(each for each in nuisances if each.key not in (STROUHAL, AMPLITUDE))
            unknowns = *self.unknowns, *nuisances
            return self._fitted(experiment, unknowns, phase, shares)

        described, far = experiment.disturbance.vortex_amplitude, search.contradicting_amplitude
        reach, one_amplitude = self._strouhal_reach(experiment), experiment.disturbance.vortex
        one_amplitude &= not has_vortex_states(experiment)
        shown = vortex_starts(self.logs, experiment, reach, self.options) if one_amplitude else []
        if shown and not described / far < shown[0][1] < described * far:
            return fitted(wide)
        model = fitted(search)
        return fitted(wide) if model.contradicts(AMPLITUDE, search.contradiction) else model

    def _likeliest(
        self, candidates: Sequence[Experiment], others: Sequence[FittedModel], lead: float
    ) -> FittedModel | None:
        """The likeliest of several experiments with nuisance parameters, and others; ``None`` if all filters diverge.

        Others have a `lead` in the deviance, because nuisance parameters increase the likelihood of any model.
        """
        found, ends = list[FittedModel](), np.linspace(0.4, 1.0, len(candidates) + 1).tolist()
        for number, each in enumerate(candidates):
            words = f"fitting also friction, inertia and damping of winches and ropes{', and a sea' * (number > 0)}"
            try:
                found.append(self._with_nuisances(each, words, (ends[number], ends[number + 1])))
            except DivergedFilterError:
                continue
        if not found:
            return None
        found += others
        leads = [0.0] * (len(found) - len(others)) + [lead * len(found)] * len(others)
        deviances = np.subtract([self._deviance_with_all_noises(model, found) for model in found], leads) / len(found)
        best = int(np.argmin(deviances))
        above = zip((deviances - deviances[best]).tolist(), found, strict=True)
        most = -2 * math.log(np.finfo(float).eps)  # beyond it a weight is lost in rounding
        rivals = tuple(pair for pair in above if pair[1] is not found[best] and pair[0] < most)
        return replace(found[best], rivals=rivals)

    def _deviance_with_all_noises(self, own: FittedModel, every: Sequence[FittedModel]) -> float:
        """The sum of a model's deviances with its own sea and the noise of sensors and torques of every model.

        Standstill is excluded for every model; otherwise that would depend on friction of the drums.
        """
        moving = sections_of(
            self.logs, with_drum_friction(own.experiment, self.options.search), self.options.resampling
        )
        filters, total = own.method.filters_of(moving), 0.0
        for other in every:
            torques = {name: other.estimate.noise.process[name] for name in ("torque_1", "torque_2")}
            process = {**own.estimate.noise.process, **torques}
            noise = replace(own.estimate.noise, measurement=other.estimate.noise.measurement, process=process)
            total += float(filters.deviances([(own.estimate.experiment, noise)])[0])
        return total

    def _fitted(
        self,
        experiment: Experiment,
        unknowns: Sequence[UnknownParameter],
        phase: str,
        shares: tuple[float, float],
        *,
        unless: Callable[[PredictionErrorMethod, Experiment, NoiseCovariances, float], bool] | None = None,
        starts: Sequence[Floats] | None = None,
    ) -> FittedModel:
        """The estimate with a model; a search for which `unless` holds after least squares ends there.

        Searches begin at `starts`; default: `starts` of the method.
        """
        sections = sections_of(self.logs, experiment, self.options.resampling)
        unknowns = *unknowns, *clock_parameters([each.key for each in unknowns], experiment, self.options)
        method = PredictionErrorMethod(sections, experiment, unknowns, self.options, self.threads)
        self.progress(shares[0], phase)
        starts = starts or self.starts(method)
        ends, found, refusal = np.linspace(*shares, len(starts) + 1).tolist(), list[ParameterEstimate](), None
        rough = partial(unless, method) if unless else None
        for number, start in enumerate(starts):
            try:
                progress = progresses.part(self.progress, ends[number], ends[number + 1])
                found.append(method.run(start, progress, unless=rough))
            except DivergedFilterError as error:
                refusal = error
        if not found:
            raise refusal or AssertionError
        best, *rest = sorted(found, key=lambda each: each.deviance)
        return FittedModel(experiment, method, best, tuple(rest))

    def starts(self, method: PredictionErrorMethod) -> list[Floats]:
        """Starts of searches: the unknowns' own, with each Strouhal number at which the logs are likely."""
        own, index = method.unknowns, {unknown.key: number for number, unknown in enumerate(method.unknowns)}
        start = np.array([unknown.start for unknown in own])
        if STROUHAL not in index:
            return [start]
        reach = self.options.search.strouhal_reach * own[index[STROUHAL]].uncertainty
        starts = list[Floats]()
        for pair in vortex_starts(self.logs, method.with_values(start), reach, self.options):
            values = start.copy()
            for key, value in zip((STROUHAL, AMPLITUDE), pair, strict=True):
                if (at := index.get(key)) is not None:
                    values[at] = np.clip(value, own[at].lower, own[at].upper)
            starts.append(values)
        return starts or [start]


def _delayed(experiment: Experiment, samples: int) -> Experiment:
    return replace(experiment, simulation=replace(experiment.simulation, delay_samples=samples))


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


def marginal(information: Floats, unknowns: Sequence[UnknownParameter], n: int) -> Floats:
    """(n, n) marginal information on the first n unknowns; the others are known by their priors only."""
    own = information[n:, n:] + np.diag([1 / each.uncertainty**2 for each in unknowns[n:]])
    return information[:n, :n] - information[:n, n:] @ np.linalg.solve(own, information[n:, :n])
