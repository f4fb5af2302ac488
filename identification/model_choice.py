"""The model of a log: the experiment as it is described or, where that leaves innovations coloured, a wider one.

What hardly any user knows is then estimated along, with wide priors: inertia of the winches, damping of the ropes,
Strouhal number, delay of the torques, and a sea that no experiment describes.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.diagnostics import UnrecordedForceError, whiteness_tests
from dualwinch.identification.estimate import DivergedFilterError, ParameterEstimate, PredictionErrorMethod
from dualwinch.identification.log import Log
from dualwinch.identification.options import EstimationOptions, SearchOptions
from dualwinch.identification.predictor import (
    READINGS,
    NoiseCovariances,
    described_disturbances,
    has_vortex_states,
)
from dualwinch.identification.resample import ANGLES, LogSection, sections_of
from dualwinch.identification.unknowns import (
    AMPLITUDE,
    STROUHAL,
    UnknownParameter,
    covariance_of,
    nuisance_parameters,
    with_drum_friction,
    with_sea,
)
from dualwinch.identification.vortices import likelier_phase, shows_other_vortices, vortex_starts
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.ropes import rope_lengths
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import PhaseProgress, part

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FittedModel:
    """A model and the estimate by it.

    Attributes:
        experiment: with sea and delay of the model.
        method: of the estimate; its unknowns are those to estimate and, behind them, those estimated along.
        estimate: by it.
        others: estimates of searches that began elsewhere.
    """

    experiment: Experiment
    method: PredictionErrorMethod
    estimate: ParameterEstimate
    others: tuple[ParameterEstimate, ...] = ()

    def notes(self, described: Experiment) -> tuple[str, ...]:
        """What the model has beside what an experiment describes, in words."""
        own, given, found = self.experiment, described.disturbance, list[str]()
        if (delay := own.simulation.delay_samples) != described.simulation.delay_samples:
            found.append(
                f"torques act {delay} samples after they are logged; simulation.delay_samples = "
                f"{described.simulation.delay_samples} stays as it is"
            )
        sea = {"vortices (disturbance.vortex)": own.disturbance.vortex and not given.vortex}
        sea["current (current_sigma)"] = own.disturbance.current_sigma > given.current_sigma
        sea["changes of the rail load (normal_force_sigma)"] = (
            own.disturbance.normal_force_sigma > given.normal_force_sigma
        )
        if self.method.options.resampling.torque_rows:
            found.append(
                "torques changed more often than they were logged: between rows their mean over "
                f"{self.method.options.resampling.torque_rows} rows is taken to act, and chatter as noise"
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
        return (*found, *self._sea_of_another_size(described))

    def _sea_of_another_size(self, described: Experiment) -> Iterator[str]:
        """A line for each described disturbance that these logs show to be of clearly another size."""
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
        """Value and standard deviation of the unknowns behind the first so many, each so many times as wide."""
        unknowns, estimate = self.method.unknowns, self.estimate
        deviations = wider * np.sqrt(np.diag(covariance_of(estimate.information, unknowns)))
        pairs = zip(estimate.values[count:].tolist(), deviations[count:].tolist(), strict=True)
        return {each.key: pair for each, pair in zip(unknowns[count:], pairs, strict=True)}

    def contradicts(self, key: str, most: float) -> bool:
        """Whether the logs contradict the prior of an unknown: it is further off than `most` expected deviations."""
        index = next((number for number, each in enumerate(self.method.unknowns) if each.key == key), None)
        unknown = None if index is None else self.method.unknowns[index]
        if index is None or unknown is None or not unknown.prior:
            return False
        left = covariance_of(self.estimate.information, self.method.unknowns)[index, index]
        off, value = self.estimate.values[index] - unknown.prior.mean, self.estimate.values[index]
        expected = math.sqrt(max(unknown.prior.deviation**2 - left, 0.0))
        return not unknown.lower < value < unknown.upper or abs(off) > most * expected

    @property
    def samples(self) -> int:
        """Of the logs, as far as they count."""
        return sum(len(section.readings) for section in self.method.filters.sections)

    @property
    def mean_deviance(self) -> float:
        """A sample's: with another delay of the torques there are others."""
        return self.estimate.deviance / self.samples

    @property
    def white(self) -> bool:
        """Whether innovations are white (`are_white`)."""
        return are_white(self.method, self.estimate.experiment, self.estimate.noise)


def are_white(method: PredictionErrorMethod, experiment: Experiment, noise: NoiseCovariances) -> bool:
    """Whether innovations are white, but for those of encoders, which count in steps, beside other sensors."""
    innovations = method.filters.whitened_innovations(experiment, noise)
    torques = [section.torques for section in method.filters.sections]
    tests = whiteness_tests(innovations, torques, method.options.diagnostics)
    return all(test.white for test in tests if test.name not in ANGLES)


@dataclass(frozen=True)
class ModelChoice:
    """Chooses the model of some logs.

    1. Where torques were logged every few samples only, the likelier at the start is chosen of torques that are held
       from row to row, and of torques that change in between (`CoarseLogOptions`), of these with each delay.
    2. The experiment as it is described is chosen where its innovations are white and smoothed readings show no other
       vortices (slow forces leave innovations white), or nothing may be estimated along.
    3. The delay of torques that were logged in every sample is that of ARX models of the load cells (`torque_lags`);
       where these do not show it clearly, the likeliest of the fits (`_with_likelier_delay`).
    4. Candidates are the experiment with friction of its drums (`unknowns.with_drum_friction`) and, where it describes
       no sea or only a part, the same with one (`unknowns.with_sea`), each with `unknowns.nuisance_parameters`. The
       search begins anew: where a model without them ends says little.
    5. Where the Strouhal number is among the unknowns, a search begins at each at which the logs are likely
       (`vortices.vortex_starts`); the optima are reported.
    6. The likeliest is chosen, or the experiment as it is described if that is likelier still, by the sum of its
       deviances with the noise of each of them: noise of sensors and torques that is not quite at its maximum changes
       the likelihood by more than a sea does.
    7. Vortices have the kind of phase that smoothed readings show (`vortices.likelier_phase`); where the amplitude of
       the paper's kind is far from the described one, the other kind is tried.

    Attributes:
        logs: of one machine.
        unknowns: to estimate.
        options: of the method.
        threads: default: one a core.
        progress: of the searches.
    """

    logs: Sequence[Log]
    unknowns: Sequence[UnknownParameter]
    options: EstimationOptions
    threads: int | None
    progress: PhaseProgress

    def of(
        self, experiment: Experiment, check: Callable[[ParameterEstimate], Sequence[str]], *, sea: bool = True
    ) -> FittedModel:
        """The model chosen for an experiment.

        Args:
            experiment: as described.
            check: refuses an implausible estimate, or returns notes on it (`diagnostics.check_fit`). Of such an
                estimate nothing but another delay makes a better one, or a sea where a force is missing.
            sea: whether a sea may be estimated along; else all forces that no experiment describes are one.

        Raises:
            DivergedFilterError: the filter diverges with every model.
            ConfigurationError: an estimate that is refused; a parameter without a prior has no effect at all.
        """
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
        """The model chosen; as `of`, with the result of `with_likeliest_torques`."""
        search, plain, notes, refusal = self.options.search, None, (), None
        roughly = partial(self._fitted, coarse or experiment, self.unknowns, "fitting", (0.0, 0.4))
        try:
            plain = roughly(unless_coloured=bool(search.nuisance_share))
            notes = check(plain.estimate)
        except ConfigurationError as error:
            refusal = error
            if plain is None and not isinstance(error, DivergedFilterError):
                raise
        sound = plain if not refusal else None
        white = bool(sound and sound.white)
        if sound and (not search.nuisance_share or (white and not (sea and self._other_vortices(sound)))):
            return sound
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
        lead = search.likelier_deviance if white else 0.0
        found = self._likeliest(candidates, [sound] if sound else [], lead) or plain
        if found and found is not plain and sea:
            found = self._with_likelier_phase(found)
        if found is None or (found is plain and refusal):
            raise refusal or AssertionError
        if found is plain:
            return roughly()
        return found if coarse else self._with_likelier_delay(found)

    def _with_likelier_phase(self, model: FittedModel) -> FittedModel:
        """A model, or that with vortices of an integrated phase where the amplitude of its own is far from described.

        Weak vortices hardly show in smoothed readings, and those of the wrong kind come to nothing, or to far too much.
        """
        own, search = model.experiment.disturbance, self.options.search
        share = model.estimate.experiment.disturbance.vortex_amplitude / (own.vortex_amplitude or 1.0)
        if not own.vortex or own.integrated_phase or search.weak_amplitude < share < search.other_amplitude:
            return model
        other = replace(model.experiment, disturbance=replace(own, integrated_phase=True))
        return self._likeliest([other], [model], 0.0) or model

    def _with_sea(self, experiment: Experiment) -> Experiment:
        """An experiment with a sea, whose vortices have the kind of phase that logs show."""
        sea = with_sea(experiment, self.options.search)
        integrated = likelier_phase(self.logs, sea, self._strouhal_reach(sea), self.options)
        return replace(sea, disturbance=replace(sea.disturbance, integrated_phase=integrated))

    def _other_vortices(self, model: FittedModel) -> bool:
        """Whether logs show vortices that an estimate lacks: slow forces leave innovations white."""
        own = model.estimate.experiment
        return shows_other_vortices(self.logs, own, self._strouhal_reach(own), self.options)

    def _strouhal_reach(self, experiment: Experiment) -> float:
        """How far from an experiment's the Strouhal number may be."""
        search = self.options.search
        return search.strouhal_reach * search.strouhal_share * experiment.disturbance.strouhal

    def _with_likelier_delay(self, model: FittedModel) -> FittedModel:
        """A model with the delay of the torques next to its own, as long as that is clearly likelier.

        An ARX model shows the delay badly where drums answer slowly to torques that hardly chatter, and a fit makes up
        for a sample by inertia and damping. Where it shows one delay clearly, no other is looked at.
        """
        search = self.options.search
        lags = self._lags(model.experiment)
        *_, second, first = np.sort(lags).tolist()
        if lags[model.experiment.simulation.delay_samples] == first > search.likelier_delay * second:
            return model
        for way in (1, -1):
            moved = False
            while 0 <= (late := model.experiment.simulation.delay_samples + way) <= search.most_delay_samples:
                values, unknowns = model.estimate.values, model.method.unknowns
                vortices = np.array([each.key in (STROUHAL, AMPLITUDE) for each in unknowns])
                starts = [np.where(vortices, values, [each.start for each in unknowns]), values]
                words = f"fitting torques that act {late} samples late"
                delayed = _delayed(model.experiment, late)
                try:
                    likelier = replace(self._fitted(delayed, unknowns, words, (0.9, 1.0), starts=starts), others=())
                except DivergedFilterError:
                    break
                if likelier.mean_deviance > model.mean_deviance - search.likelier_deviance / model.samples:
                    break
                model, moved = likelier, True
            if moved:
                break
        return model

    def _lags(self, experiment: Experiment) -> Floats:
        """Significance of each delay of the torques (`torque_lags`)."""
        sections = sections_of(self.logs, _delayed(experiment, 0), self.options.resampling)
        return torque_lags(sections, self.options.search.delay_order)

    def with_likeliest_torques(self, experiment: Experiment) -> "tuple[ModelChoice, Experiment | None]":
        """The choice and the experiment by which torques between rows, and their delay, are likeliest at the start.

        None in the place of the experiment: torques are held from row to row.

        Raises:
            ConfigurationError: torques change between rows that are too far apart.
        """
        coarse, step = self.options.search.coarse, experiment.simulation.sample_time
        if all(np.median(np.diff(log.t)) < coarse.spacing * step for log in self.logs):
            return self, None
        noise = replace(
            self.options.noise,
            torque_time=coarse.chatter_time * step,
            least_torque=coarse.least_chatter,
            quiet_share=coarse.quiet_share,
        )
        resampling = replace(self.options.resampling, torque_rows=coarse.rows)
        other = replace(self, options=replace(self.options, resampling=resampling, noise=noise))
        least, delayed = other.likeliest_at_start(experiment)
        if least >= self.deviance_at_start(experiment):
            return self, None
        self._check_spacing(experiment)
        return other, delayed

    def likeliest_at_start(self, experiment: Experiment) -> tuple[float, Experiment]:
        """The least deviance where the search begins, and the experiment with the delay of the torques that has it."""
        delayed = [_delayed(experiment, late) for late in range(self.options.search.most_delay_samples + 1)]
        return min(((self.deviance_at_start(each), each) for each in delayed), key=itemgetter(0))

    def _check_spacing(self, experiment: Experiment) -> None:
        """Refuse logs with torques that change between rows, and rows too far apart to see the drums' resonance.

        Load cells alias the resonance then, and masses come out too large by several standard deviations.
        """
        plant = experiment.plant
        least = min(
            side.winch.drum_radius * math.sqrt(float(side.rope.tangent(1.0, length)[0]) / side.winch.inertia) / math.tau
            for x in (0.0, plant.track.length)
            for side, length in zip(plant.sides, rope_lengths(x, plant.track), strict=True)
        )
        for log in self.logs:
            if (spacing := float(np.median(np.diff(log.t)))) > 1 / (2 * least):
                raise ConfigurationError(
                    f"{log.name}: has a row every {1e3 * spacing:.3g} ms, its torques change in between, and its drums "
                    f"swing on the ropes at {least:.3g} Hz or more: must have a row every {500 / least:.2g} ms or less"
                )

    def deviance_at_start(self, experiment: Experiment) -> float:
        """Of an experiment whose drums rub, where the search for the unknowns begins, with the likeliest Q."""
        rubbing = with_drum_friction(experiment, self.options.search)
        sections = sections_of(self.logs, rubbing, self.options.resampling)
        method = PredictionErrorMethod(sections, rubbing, self.unknowns, self.options, self.threads)
        return method.deviance(np.array([unknown.start for unknown in self.unknowns]))

    def _with_delay(self, experiment: Experiment) -> Experiment:
        """The experiment with the delay of the torques that the logs have, as far as they show it."""
        search, significance = self.options.search, self._lags(experiment)
        delay, described = (
            int(np.argmax(significance[: search.most_delay_samples + 1])),
            experiment.simulation.delay_samples,
        )
        if described < len(significance) and significance[delay] <= search.likelier_delay * significance[described]:
            return experiment
        return _delayed(experiment, delay)

    def _with_nuisances(self, experiment: Experiment, phase: str, shares: tuple[float, float]) -> FittedModel:
        """The estimate with parameters estimated along, the vortices' amplitude near the described one if possible."""
        search, keys = self.options.search, [unknown.key for unknown in self.unknowns]
        wide = replace(search, amplitude_share=search.wide_amplitude_share)

        def fitted(search: SearchOptions) -> FittedModel:
            unknowns = *self.unknowns, *nuisance_parameters(keys, experiment, search)
            return self._fitted(experiment, unknowns, phase, shares)

        described, far = experiment.disturbance.vortex_amplitude, search.other_amplitude
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
        """The likeliest of some experiments with parameters estimated along, and others; None: all filters diverge.

        What is estimated along makes each likelier, others have a lead in the deviance for that.
        """
        found, ends = list[FittedModel](), np.linspace(0.4, 1.0, len(candidates) + 1).tolist()
        for number, each in enumerate(candidates):
            words = f"fitting friction, inertia and damping of winches and ropes along{', and a sea' * (number > 0)}"
            try:
                found.append(self._with_nuisances(each, words, (ends[number], ends[number + 1])))
            except DivergedFilterError:
                continue
        if not found:
            return None
        found += others
        leads = [0.0] * (len(found) - len(others)) + [lead * len(found)] * len(others)
        deviances = [self._deviance_with_all_noises(model, found) for model in found]
        return found[int(np.argmin(np.subtract(deviances, leads)))]

    def _deviance_with_all_noises(self, own: FittedModel, every: Sequence[FittedModel]) -> float:
        """The sum of a model's deviances with its own sea and the noise of sensors and torques of every model.

        Standstill counts with none: whether it does depends on friction of the drums.
        """
        moving = sections_of(
            self.logs, with_drum_friction(own.experiment, self.options.search), self.options.resampling
        )
        filters, total = own.method.filters_of(moving), 0.0
        for other in every:
            torques = {name: other.estimate.noise.process[name] for name in ("torque_1", "torque_2")}
            process = {**own.estimate.noise.process, **torques}
            noise = replace(own.estimate.noise, measurement=other.estimate.noise.measurement, process=process)
            total += float(filters.deviances([own.estimate.experiment], noise)[0])
        return total

    def _fitted(
        self,
        experiment: Experiment,
        unknowns: Sequence[UnknownParameter],
        phase: str,
        shares: tuple[float, float],
        *,
        unless_coloured: bool = False,
        starts: Sequence[Floats] | None = None,
    ) -> FittedModel:
        """The estimate by a model; one that leaves coloured innovations may be but a rough one.

        Searches begin at `starts`, by default those of the method's.
        """
        sections = sections_of(self.logs, experiment, self.options.resampling)
        method = PredictionErrorMethod(sections, experiment, unknowns, self.options, self.threads)
        self.progress(shares[0], phase)
        starts = starts or self.starts(method)
        ends, found, refusal = np.linspace(*shares, len(starts) + 1).tolist(), list[ParameterEstimate](), None

        def coloured(there: Experiment, noise: NoiseCovariances) -> bool:
            return not are_white(method, there, noise)

        unless = coloured if unless_coloured else None
        for number, start in enumerate(starts):
            try:
                progress = part(self.progress, ends[number], ends[number + 1])
                found.append(method.run(start, progress, unless=unless))
            except DivergedFilterError as error:
                refusal = error
        if not found:
            raise refusal or AssertionError
        best, *rest = sorted(found, key=lambda each: each.deviance)
        return FittedModel(experiment, method, best, tuple(rest))

    def starts(self, method: PredictionErrorMethod) -> list[Floats]:
        """Where searches begin: where the unknowns start, with each Strouhal number at which the logs are likely."""
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
    """(order,) squares of the t-values of the torques of 0, 1, ... samples ago in ARX models of the load cells.

    Each tension is regressed on its own last `order` values, which leaves nothing of the loop that makes the torques,
    and on as many torques of the past. Zeros where no load cell shows it.
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
    """(n, n) information on the first n of some unknowns, the others unknown but for their priors."""
    own = information[n:, n:] + np.diag([1 / each.uncertainty**2 for each in unknowns[n:]])
    return information[:n, :n] - information[:n, n:] @ np.linalg.solve(own, information[n:, :n])
