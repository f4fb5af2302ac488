"""Selection of a model for logs: the experiment as described, or one with some of the named alternatives."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import Experiment, progresses
from dualwinch.toolboxes.identification.alternatives import (
    ALTERNATIVES,
    InterpolatedRows,
    LightRopes,
    RecorderPhase,
    TorqueDelay,
    WinchesAndRopes,
)
from dualwinch.toolboxes.identification.diagnostics import ImplausibleFitError
from dualwinch.toolboxes.identification.estimate import DivergedFilterError, ParameterEstimate, PredictionErrorMethod
from dualwinch.toolboxes.identification.models import FittedModel, LogModel, ModelEvidence, are_white
from dualwinch.toolboxes.identification.options import EstimationOptions
from dualwinch.toolboxes.identification.predictor import NoiseCovariances, RecordedExperiment, with_rows_at_samples
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.screening import LogScreening
from dualwinch.toolboxes.identification.unknowns import (
    AMPLITUDE,
    STROUHAL,
    clock_parameters,
    covariance_of,
    nuisance_parameters,
    with_drum_friction,
)
from dualwinch.toolboxes.identification.vortices import vortex_starts

Floats = NDArray[np.float64]

CLOCKS = {RecorderPhase.kind, InterpolatedRows.kind}
"""Kinds of models of a recorder with a clock of its own."""


def _is_coloured(
    method: PredictionErrorMethod, experiment: Experiment, noise: NoiseCovariances, _deviance: float
) -> bool:
    return not are_white(method, experiment, noise)


def _likeliest_of(
    model: LogModel,
    method: PredictionErrorMethod,
    searches: Iterable[Callable[[], ParameterEstimate]],
    check: Callable[[FittedModel], Sequence[str]],
) -> FittedModel:
    """A model with the likeliest estimate of several searches, and what a check says of it.

    Raises:
        DivergedFilterError: the filter diverges in every search.
    """
    estimates, refusal = list[ParameterEstimate](), None
    for search in searches:
        try:
            estimates.append(search())
        except DivergedFilterError as error:
            refusal = error
    if not estimates:
        raise refusal or AssertionError
    best, *optima = sorted(estimates, key=lambda each: each.deviance)
    fit = FittedModel(model, method, best, tuple(optima))
    try:
        return replace(fit, remarks=tuple(check(fit)))
    except ImplausibleFitError as error:
        return replace(fit, refusal=error)


@dataclass
class ModelSelection:
    """Stepwise selection of a model by the Bayesian information criterion, and averaging over close ones.

    1. Where ropes clearly show no weight or mass, or rows are between the samples, the described experiment is fitted
       with that from the first (`base`); else as it is.
    2. Each alternative in turn proposes candidates: the likeliest model so far with it, or with another form of it.
       One that the innovations (whiteness) or quick looks at the logs (`screening`) do not call for proposes none.
    3. Each candidate is fitted, by a search of its own from the starts, because the optimum of a model without an
       effect is a poor start. It ends where no neighbour one standard deviation away is likelier. If its criterion is
       lower, the search goes on from it.
       A recorder's clock that is not needed is left out again (`_without_clock`), for it may stand in for a delay.
    4. When no alternative has a candidate left, the model with the least criterion is chosen among plausible ones.
       Those within `SearchOptions.considerable` of it are its rivals, over which estimates are averaged (Burnham and
       Anderson, Model Selection and Multimodel Inference, 2002, Chapter 4).

    Criteria are compared with the noise of sensors and torques of every model, as noise that is not quite at its
    maximum changes the likelihood by more than a sea does.

    Attributes:
        screening: of the logs, which are of one machine.
        options: of the method.
        check: refuses an implausible fit, or returns remarks on it.
        progress: called with the share of the work.
        fits: so far, the described experiment first.
        interrupted: whether it was interrupted before all candidates were fitted.
    """

    screening: LogScreening
    options: EstimationOptions
    check: Callable[[FittedModel], Sequence[str]]
    progress: progresses.PhaseProgress
    fits: list[FittedModel] = field(default_factory=list)
    interrupted: bool = False
    _pairs: dict[tuple[FittedModel, FittedModel], float] = field(default_factory=dict, init=False, repr=False)

    def of(self, experiment: Experiment, *, plain: bool = False) -> FittedModel:
        """The selected model for an experiment as described; `plain`: this experiment, whatever its innovations.

        An interruption (Ctrl-C) after the first fit ends the selection, with the models so far.

        Raises:
            DivergedFilterError: the filter diverges with every model.
            ConfigurationError: the estimate is refused, or a parameter without a prior has no effect at all.
        """
        described = LogModel(experiment, self.options)
        if plain or not self.screening.kinds:
            fit = self._fitted(described, complete=True)
            if plain and fit.refusal:
                raise type(fit.refusal)(f"{fit.refusal}; without --plain, alternatives to that machine are compared")
            return self._accepted(fit)
        base = self.base(described)
        try:
            self._fitted(base)
        except DivergedFilterError:
            others = [self.screening.with_torques_between_rows(base), self._without_divergence(base)]
            wider = next(filter(None, others), None)
            if wider is None:
                raise
            self._fitted(wider)
        try:
            best = self._selected(base)
        except KeyboardInterrupt:
            self.interrupted = True
            best = self._likeliest()
        return self._accepted(best)

    def _selected(self, base: LogModel) -> FittedModel:
        """The likeliest fit once no alternative has a candidate left (steps 2 to 4)."""
        tried, proposals = {fit.model for fit in self.fits} | {base}, dict[FittedModel, Iterator[LogModel]]()
        while True:
            best = self._likeliest()
            proposed = proposals.setdefault(best, self._candidates(best))
            candidate = next((each for each in proposed if each not in tried), None)
            if candidate is not None:
                tried.add(candidate)
                with suppress(DivergedFilterError):
                    self._fitted(candidate)
            elif best.finished or best.refusal:
                return best
            else:
                complete = self._completed(best)
                self.fits[self.fits.index(best)] = complete
                proposals[complete] = iter(())

    def base(self, described: LogModel) -> LogModel:
        """The described model, with the form of its ropes and rows that no fit can do without."""
        screening = self.screening
        if LightRopes.kind in screening.kinds:
            likeliest = screening.likeliest_ropes(described.experiment, self.options)
            if likeliest != described.experiment:
                described = described.extended(LightRopes.kind, likeliest)
        experiment = described.experiment
        if not screening.at_samples(experiment):
            kinds = [kind for kind in (RecorderPhase, InterpolatedRows) if kind.kind in screening.kinds]
            clock = screening.likeliest_clock(
                experiment, self.options, interpolated=[kind.interpolated for kind in kinds]
            )
            if clock:
                kind = next(each for each in kinds if each.interpolated == clock.recorder.interpolated)
                return described.extended(kind.kind, clock)
        return described

    def _without_divergence(self, base: LogModel) -> LogModel | None:
        """The model with the delay that load cells show, and friction, inertia and damping estimated along."""
        if WinchesAndRopes.kind not in self.screening.kinds or not self.options.search.nuisance_share:
            return None
        samples = self.screening.delay_in(base.experiment, base.options)
        simulation = replace(base.experiment.simulation, delay_samples=samples)
        experiment = with_drum_friction(replace(base.experiment, simulation=simulation), self.options.search)
        keys = [each.key for each in self.screening.unknowns]
        return base.extended(
            WinchesAndRopes.kind, experiment, nuisance_parameters(keys, experiment, self.options.search)
        )

    def _candidates(self, best: FittedModel) -> Iterator[LogModel]:
        """Candidates of all alternatives to the likeliest fit.

        A clock of a recorder whose rows are at the samples may make up for something else: where it leaves innovations
        coloured, other alternatives are tried without it, too, and in the end it is left out (`_without_clock`).
        """
        fits = [best]
        if CLOCKS & set(best.model.kinds) and self.screening.at_samples(self.fits[0].experiment) and not best.white:
            fits.insert(0, self._likeliest([fit for fit in self.fits if not CLOCKS & set(fit.model.kinds)]))
        for fit in fits:
            for kind, alternative in ALTERNATIVES.items():
                if kind in self.screening.kinds:
                    yield from alternative().candidates(fit, self.screening)
        yield from self._without_clock(best)

    def _without_clock(self, fit: FittedModel) -> Iterator[LogModel]:
        """The model with rows at the samples, if that cannot be excluded by its clock (Wald's test).

        The distance of the estimated delay from a whole number of samples, and of the rate from the controller's, in
        their covariance, is about the deviance that leaving out the clock adds; the criterion allows
        log(readings) for each of the two.
        """
        experiment, described = fit.experiment, self.fits[0].experiment
        if not isinstance(experiment, RecordedExperiment) or not self.screening.at_samples(described):
            return
        simulation = experiment.simulation
        step = simulation.sample_time * experiment.recorder.steps
        unknowns = fit.method.unknowns
        places = [place for place, each in enumerate(unknowns) if each.key.startswith("recorder.")]
        clock = dict(zip([unknowns[place].key for place in places], fit.estimate.values[places], strict=True))
        late = simulation.delay_samples * simulation.sample_time - clock["recorder.phase"]
        samples = round(late / step)
        distance = np.array([samples * step - late if key == "recorder.phase" else size for key, size in clock.items()])
        covariance = covariance_of(fit.estimate.information, unknowns)[np.ix_(places, places)]
        deviance = float(distance @ np.linalg.solve(covariance, distance))
        is_delayed = samples != described.simulation.delay_samples
        if deviance > len(places) * np.log(fit.readings) or (
            is_delayed and TorqueDelay.kind not in self.screening.kinds
        ):
            return
        model, at_samples = fit.model.without(*CLOCKS), with_rows_at_samples(experiment, samples)
        if is_delayed:
            yield model.extended(TorqueDelay.kind, at_samples, further=1)
        else:
            yield replace(model, experiment=at_samples)

    def _accepted(self, best: FittedModel) -> FittedModel:
        """A fit with its rivals; its refusal is raised."""
        if best.refusal:
            raise best.refusal
        criteria = self._criteria()
        least = criteria[self.fits.index(best)]
        return replace(
            best,
            rivals=tuple(
                (criterion - least, fit)
                for criterion, fit in zip(criteria, self.fits, strict=True)
                if fit is not best and not fit.refusal and criterion - least < self.options.search.considerable
            ),
        )

    def _likeliest(self, fits: Sequence[FittedModel] | None = None) -> FittedModel:
        """The fit with the least criterion among plausible ones, or of all if there is none; default: of all fits."""
        every = self.fits if fits is None else fits
        pairs = [pair for pair in zip(self._criteria(), self.fits, strict=True) if pair[1] in every]
        plausible = [pair for pair in pairs if not pair[1].refusal]
        return min(plausible or pairs, key=itemgetter(0))[1]

    def _deviances(self) -> list[float]:
        """Deviance of each fit with its own sea and the noise of sensors and torques of every fit, on average.

        Per reading times the readings of the first: another delay leaves out others at the start.
        """
        means = [np.mean([self._deviance_per_reading(fit, other) for other in self.fits]) for fit in self.fits]
        return [float(mean) * self.fits[0].readings for mean in means]

    def _deviance_per_reading(self, fit: FittedModel, other: FittedModel) -> float:
        """Deviance of a fit with the noise of sensors and torques of another.

        Standstill is excluded for every model; otherwise that would depend on friction of the drums.
        """
        pair = fit, other
        if pair not in self._pairs:
            experiment, noise = with_drum_friction(fit.experiment, self.options.search), fit.estimate.noise
            moving = sections_of(self.screening.logs, experiment, fit.method.options.resampling)
            readings = sum(int(np.isfinite(section.readings).sum()) for section in moving)
            torques = {name: other.estimate.noise.process[name] for name in ("torque_1", "torque_2")}
            process = {**noise.process, **torques}
            noise = replace(noise, measurement=other.estimate.noise.measurement, process=process)
            (deviance,) = fit.method.filters_of(moving).deviances([(fit.estimate.experiment, noise)]).tolist()
            self._pairs[pair] = deviance / readings
        return self._pairs[pair]

    def _criteria(self) -> list[float]:
        deviances = self._deviances()
        return [fit.information_criterion(each) for fit, each in zip(self.fits, deviances, strict=True)]

    def evidence(self, chosen: FittedModel) -> tuple[ModelEvidence, ...]:
        """All fits beside each other, in the order in which they were made."""
        deviances, criteria = self._deviances(), self._criteria()
        averaged = [chosen.estimate, *(fit.estimate for _, fit in chosen.rivals)]
        weights = {id(estimate): weight for estimate, weight in zip(averaged, chosen.weights, strict=True)}
        return tuple(
            ModelEvidence(
                alternatives=fit.model.kinds,
                parameters=fit.parameters,
                deviance=deviance - min(deviances),
                criterion=criterion - min(criteria),
                weight=weights.get(id(fit.estimate), 0.0),
                refusal=str(fit.refusal or ""),
            )
            for fit, deviance, criterion in zip(self.fits, deviances, criteria, strict=True)
        )

    def _fitted(self, model: LogModel, *, complete: bool = False) -> FittedModel:
        """Fit a model from each of its starts, and add it to the fits.

        Unless it must be `complete`, a fit without nuisance parameters that leaves innovations coloured ends roughly,
        after least squares.

        Raises:
            DivergedFilterError: the filter diverges from every start.
        """
        experiment, screening = model.experiment, self.screening
        sections = sections_of(screening.logs, experiment, model.options.resampling)
        unknowns = *screening.unknowns, *model.nuisances
        unknowns = *unknowns, *clock_parameters([each.key for each in unknowns], experiment, model.options)
        method = PredictionErrorMethod(sections, experiment, unknowns, model.options, screening.threads)
        rough = partial(_is_coloured, method) if self.screening.kinds and not (model.nuisances or complete) else None
        starts = self.starts(method)
        searches = (
            partial(method.run, start, progress, unless=rough, polished=False)
            for start, progress in zip(starts, self._progresses(model, len(starts)), strict=True)
        )
        fit = _likeliest_of(model, method, searches, self.check)
        self.fits.append(fit)
        return fit

    def _completed(self, fit: FittedModel) -> FittedModel:
        """A fit that ended roughly, at the maximum of the likelihood."""
        method, rough = fit.method, (fit.estimate, *fit.optima)
        searches = (
            partial(method.continued, each.values, each.noise, progress, polished=False)
            for each, progress in zip(rough, self._progresses(fit.model, len(rough)), strict=True)
        )
        return _likeliest_of(fit.model, method, searches, self.check)

    def _progresses(self, model: LogModel, count: int) -> Iterator[progresses.Progress]:
        """Progress of each of several searches for a model; how many models follow is not known.

        Its phase has the estimates of the likeliest model so far, too.
        """
        number = len(self.fits)
        ends = np.linspace(1 - 0.5**number, 1 - 0.5 ** (number + 1), count + 1).tolist()
        phase = "fitting" if not model.kinds else f"fitting with {', '.join(model.kinds)}"
        if self.fits:
            best = self._likeliest()
            estimates = "no plausible fit" if best.refusal else best.words(len(self.screening.unknowns))
            phase += f" · so far {estimates}"
        self.progress(ends[0], phase)
        for begin, end in pairwise(ends):
            yield progresses.part(self.progress, begin, end)

    def starts(self, method: PredictionErrorMethod) -> list[Floats]:
        """Starts of searches: the unknowns' own, with each Strouhal number at which the logs are likely."""
        unknowns = method.unknowns
        index = {unknown.key: number for number, unknown in enumerate(unknowns)}
        start = np.array([unknown.start for unknown in unknowns])
        if STROUHAL not in index:
            return [start]
        reach = self.options.search.reach * unknowns[index[STROUHAL]].uncertainty
        starts = list[Floats]()
        for pair in vortex_starts(self.screening.logs, method.with_values(start), reach, self.options):
            values = start.copy()
            for key, value in zip((STROUHAL, AMPLITUDE), pair, strict=True):
                if (at := index.get(key)) is not None:
                    values[at] = np.clip(value, unknowns[at].lower, unknowns[at].upper)
            starts.append(values)
        return starts or [start]
