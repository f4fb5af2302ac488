"""Named alternatives to the experiment as described, each a part: what the experiment may lack, or describe otherwise.

A user's own is a frozen dataclass with `effect`, registered like every other part::

    @dw.register
    @dataclass(frozen=True)
    class SheaveFriction(Alternative):
        kind: ClassVar = "sheave-friction"
        meaning: ClassVar = "ropes rub on the sheaves"

        def effect(self, experiment):
            return {f"plant.winch_{side}.sheave_friction": 0.02 for side in (1, 2)}
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dualwinch.toolbox import ConfigurationError, Experiment, leaves, parts, with_leaves
from dualwinch.toolboxes.identification.diagnostics import UnrecordedForceError
from dualwinch.toolboxes.identification.models import FittedModel, LogModel
from dualwinch.toolboxes.identification.predictor import RecordedExperiment
from dualwinch.toolboxes.identification.screening import LogScreening, delayed, ropes_of
from dualwinch.toolboxes.identification.unknowns import (
    AMPLITUDE,
    LOAD_CELL_LAG,
    STROUHAL,
    Prior,
    UnknownParameter,
    nuisance_parameters,
    unknown_parameters,
    with_drum_friction,
    with_load_cell_lag,
    with_sea,
)


class Alternative(parts.Part):
    """Base of the alternatives.

    Attributes:
        kind: by which it is named on command lines.
        meaning: in a line.
    """

    meaning: ClassVar[str]

    @abstractmethod
    def effect(self, experiment: Experiment) -> Mapping[str, float]:
        """Values of an experiment with the effect at its expected size, by key.

        Those that the experiment lacks are estimated along, each with a prior as wide as its size.
        """

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:  # noqa: ARG002
        """Models with this alternative, or another form of it, in addition to those of the likeliest fit so far.

        By default one with its `effect`, if the fit leaves innovations coloured or is implausible.
        """
        values = leaves(fit.experiment)
        effect = {key: value for key, value in self.effect(fit.experiment).items() if not values[key]}
        if not effect or self.kind in fit.model.kinds or _is_sound(fit):
            return
        experiment = with_leaves(fit.experiment, effect)
        priors = {key: Prior(value, abs(value)) for key, value in effect.items()}
        nuisances = unknown_parameters(tuple(effect), experiment, priors, fit.model.options.search)
        yield fit.model.extended(self.kind, experiment, nuisances)


class BuiltIn(Alternative):
    """Base of alternatives whose candidates are shown by the log."""

    def effect(self, experiment: Experiment) -> Mapping[str, float]:  # noqa: ARG002
        """None."""
        return {}


def _is_sound(fit: FittedModel) -> bool:
    """Whether a fit is plausible and leaves white innovations."""
    return fit.refusal is None and fit.white


def _is_other_machine(fit: FittedModel, screening: LogScreening) -> bool:
    """Whether a fit needs large unrecorded torques or noise and no delay is likelier: no force on the vehicle helps."""
    if isinstance(fit.refusal, UnrecordedForceError) or not (fit.refusal or fit.remarks):
        return False
    return "torque-delay" not in screening.kinds or (
        screening.likeliest_at_start(fit.experiment, fit.model.options)[1] == fit.experiment
    )


@dataclass(frozen=True)
class LightRopes(BuiltIn):
    """Ropes whose weight, or mass, does not show.

    What sags between rollers swings for long in a model without disturbances of its own, and where a rope slackens its
    sag grows far; a log of taut ropes then needs forces that were not there.
    """

    kind: ClassVar = "light-ropes"
    meaning: ClassVar = "ropes move as if they had no weight, or no mass"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """The ropes, of the described or lighter ones, that are likeliest at the estimate with its noise."""
        if _is_sound(fit):
            return
        model, estimate = fit.model, fit.estimate
        described = with_leaves(estimate.experiment, ropes_of(screening.described))
        likeliest = ropes_of(screening.likeliest_ropes(described, model.options, estimate.noise))
        if likeliest == ropes_of(fit.experiment):
            return
        other, experiment = model.without(self.kind), with_leaves(fit.experiment, likeliest)
        if likeliest == ropes_of(screening.described):
            yield replace(other, experiment=experiment)
        else:
            yield other.extended(self.kind, experiment)


@dataclass(frozen=True)
class RecorderPhase(BuiltIn):
    """Rows measured between the controller's samples."""

    kind: ClassVar = "recorder-clock"
    meaning: ClassVar = "the recorder samples between the controller's samples"
    interpolated: ClassVar = False

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """The likeliest clock at the start, if rows are at the samples by their times."""
        if {*fit.model.kinds} - {LightRopes.kind} or not screening.at_samples(fit.experiment):
            return
        clock = screening.likeliest_clock(fit.experiment, fit.model.options)
        if clock and clock.recorder.interpolated == self.interpolated:
            yield fit.model.extended(self.kind, clock)


@dataclass(frozen=True)
class InterpolatedRows(RecorderPhase):
    """Rows that a tool interpolated, means of two readings."""

    kind: ClassVar = "interpolated-rows"
    meaning: ClassVar = "rows were interpolated between the controller's samples"
    interpolated: ClassVar = True


@dataclass(frozen=True)
class TorquesBetweenRows(BuiltIn):
    """Torques that chatter at the controller's rate, of which a log holds every few."""

    kind: ClassVar = "torques-between-rows"
    meaning: ClassVar = "torques changed more often than they were logged"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """One with mean torques between rows, if that is likelier at the estimate.

        Raises:
            ConfigurationError: rows are too far apart for that (`screening.LogScreening.check_spacing`).
        """
        if _is_sound(fit) or isinstance(fit.experiment, RecordedExperiment):
            return
        values = None if fit.refusal else fit.estimate.values[: len(screening.unknowns)]
        model = screening.with_torques_between_rows(fit.model, values)
        if model:
            yield model


@dataclass(frozen=True)
class TorqueDelay(BuiltIn):
    """Another ``simulation.delay_samples``."""

    kind: ClassVar = "torque-delay"
    meaning: ClassVar = "torques act more or fewer samples late"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """The delay that load cells determine, else those one sample longer and shorter, the likelier one first.

        ARX models do not determine it well if drums respond slowly to torques without chatter, and a fit can compensate
        a sample by inertia and damping.
        """
        options, experiment = fit.model.options, fit.experiment
        if isinstance(experiment, RecordedExperiment) or options.resampling.between_rows or _is_sound(fit):
            return
        here, search = experiment.simulation.delay_samples, options.search
        samples = [screening.delay_in(experiment, options)]
        if samples == [here]:
            lags = screening.lags(experiment, options)
            *_, second, largest = np.sort(lags).tolist()
            if lags[here] == largest > search.delay_significance * second:
                return
            samples = [each for each in (here + 1, here - 1) if 0 <= each <= search.max_delay_samples]
            neighbours = [delayed(fit.estimate.experiment, each) for each in samples]
            deviances = screening.deviances_with(fit.estimate.noise, neighbours, options)
            samples = [samples[place] for place in np.argsort(deviances)]
        described = screening.described.simulation.delay_samples
        for each in samples:
            model, other = fit.model, delayed(experiment, each)
            if each != described:
                yield model.extended(self.kind, other, further=self.kind not in model.kinds)
            elif self.kind in model.kinds:
                yield replace(model.without(self.kind), experiment=other, further=model.further - 1)


@dataclass(frozen=True)
class WinchesAndRopes(BuiltIn):
    """Friction of the drums, and inertia and damping other than described."""

    kind: ClassVar = "winches-and-ropes"
    meaning: ClassVar = "friction and inertia of the winches, and damping of the ropes"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """One with all of them, if innovations are coloured, or logs show other vortices."""
        model = fit.model
        if self.kind in model.kinds or not model.options.search.nuisance_share or _explains(fit, screening):
            return
        experiment = with_drum_friction(fit.experiment, model.options.search)
        yield model.extended(self.kind, experiment, _nuisances(experiment, fit, screening))


@dataclass(frozen=True)
class UndescribedSea(BuiltIn):
    """Vortices, a current and changes of the rail load, as far as none is described."""

    kind: ClassVar = "sea"
    meaning: ClassVar = "a current, changes of the rail load and vortices"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """One with a moderate sea, whose vortices have the kind of phase that logs show."""
        model, search = fit.model, fit.model.options.search
        if self.kind in model.kinds or not search.nuisance_share or _explains(fit, screening):
            return
        if _is_other_machine(fit, screening):
            return
        experiment = with_sea(fit.experiment, search)
        integrated = screening.integrated_phase(experiment, model.options)
        experiment = replace(experiment, disturbance=replace(experiment.disturbance, integrated_phase=integrated))
        if experiment == fit.experiment:
            return
        sea, described = experiment.disturbance, fit.experiment.disturbance
        processes = (sea.current_sigma, described.current_sigma), (sea.normal_force_sigma, described.normal_force_sigma)
        nuisances = _nuisances(experiment, fit, screening)
        if WinchesAndRopes.kind not in model.kinds:
            nuisances = tuple(each for each in nuisances if each.key in (STROUHAL, AMPLITUDE))
        yield model.extended(
            self.kind, experiment, nuisances, further=sum(2 for size, before in processes if size != before)
        )


@dataclass(frozen=True)
class VortexPhase(BuiltIn):
    """Vortices whose phase is the integral of their frequency (E4)."""

    kind: ClassVar = "vortex-phase"
    meaning: ClassVar = "the phase of the vortices is integrated, or not, unlike the described one"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:  # noqa: ARG002
        """One with integrated phase, if the estimated amplitude is not significant, or contradicts its prior.

        Weak vortices hardly show in smoothed readings, and with the wrong kind of phase their estimated amplitude is
        almost zero or far too large.
        """
        sea, keys = fit.experiment.disturbance, {each.key for each in fit.method.unknowns}
        if not sea.vortex or sea.integrated_phase or AMPLITUDE not in keys or self.kind in fit.model.kinds:
            return
        if fit.is_significant(AMPLITUDE) and not fit.contradicts(AMPLITUDE):
            return
        experiment = replace(fit.experiment, disturbance=replace(sea, integrated_phase=True))
        nuisances = tuple(each for each in fit.model.nuisances if each.key != AMPLITUDE)
        yield replace(fit.model, nuisances=nuisances).extended(self.kind, experiment)


@dataclass(frozen=True)
class VortexAmplitude(BuiltIn):
    """Vortices of quite another size."""

    kind: ClassVar = "vortex-amplitude"
    meaning: ClassVar = "vortices are much weaker or stronger than described"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:  # noqa: ARG002
        """One with a prior of the amplitude as wide as itself, if the estimate contradicts a narrower one."""
        if AMPLITUDE not in {each.key for each in fit.model.nuisances} or self.kind in fit.model.kinds:
            return
        if not fit.contradicts(AMPLITUDE):
            return
        wide = replace(fit.model.options.search, amplitude_share=1.0)
        nuisances = [each for each in nuisance_parameters((), fit.experiment, wide) if each.key == AMPLITUDE]
        yield fit.model.extended(self.kind, fit.experiment, nuisances)


@dataclass(frozen=True)
class LoadCellLag(BuiltIn):
    """A first-order lag of both load cells."""

    kind: ClassVar = "load-cell-lag"
    meaning: ClassVar = "load cells lag behind the tensions"

    def candidates(self, fit: FittedModel, screening: LogScreening) -> Iterator[LogModel]:
        """One with a lag with which logs are likelier at the start, unless another delay without one is likelier."""
        model = fit.model
        options = model.options
        lagging_already = self.kind in model.kinds or options.resampling.between_rows
        if lagging_already or not options.search.nuisance_share or _is_sound(fit):
            return
        values = None if fit.refusal else fit.estimate.values[: len(screening.unknowns)]
        lag = screening.load_cell_lag(fit.experiment, options, values)
        if not lag:
            return
        lagged = with_load_cell_lag(fit.experiment, lag)
        if not isinstance(lagged, RecordedExperiment):
            (lagging, lagged), (punctual, _) = (
                screening.likeliest_at_start(each, options) for each in (lagged, fit.experiment)
            )
            if lagging >= punctual:  # a wrong delay looks like a lag
                return
        prior = {LOAD_CELL_LAG: Prior(lag, lag)}
        yield model.extended(self.kind, lagged, unknown_parameters((LOAD_CELL_LAG,), lagged, prior, options.search))


@dataclass(frozen=True)
class StartUnderWay(BuiltIn):
    """A log that was cut out of a run, whose vortices have the phase of its time.

    That is determined before the first fit (`vortices.with_vortex_origin`).
    """

    kind: ClassVar = "start-under-way"
    meaning: ClassVar = "the log begins during a run"


ALTERNATIVES: parts.Registry[Alternative] = parts.Registry(
    "alternative",
    LightRopes,
    RecorderPhase,
    InterpolatedRows,
    TorqueDelay,
    TorquesBetweenRows,
    WinchesAndRopes,
    UndescribedSea,
    VortexPhase,
    VortexAmplitude,
    LoadCellLag,
    StartUnderWay,
)
"""All alternatives, in the order in which they are tried."""


def _explains(fit: FittedModel, screening: LogScreening) -> bool:
    """Whether a fit explains the logs: it is sound, and they show no other vortices."""
    return _is_sound(fit) and (UndescribedSea.kind not in screening.kinds or not screening.other_vortices(fit))


def _nuisances(experiment: Experiment, fit: FittedModel, screening: LogScreening) -> tuple[UnknownParameter, ...]:
    """Nuisance parameters of an experiment; those of vortices only where a sea is allowed."""
    keys = [each.key for each in screening.unknowns]
    every = nuisance_parameters(keys, experiment, fit.model.options.search)
    return tuple(
        each for each in every if UndescribedSea.kind in screening.kinds or each.key not in (STROUHAL, AMPLITUDE)
    )


def selected(names: Sequence[str]) -> frozenset[str]:
    """Kinds of alternatives by names: `all`, names to add, and names with a minus to leave out; default: all.

    >>> sorted(selected(["sea", "load-cell-lag"]))
    ['load-cell-lag', 'sea']
    >>> len(selected(["all,-sea"])) == len(ALTERNATIVES) - 1
    True

    Raises:
        ConfigurationError: a name of none.
    """
    every = [name.strip() for text in names for name in text.split(",")]
    kinds = set[str]() if every and not every[0].startswith("-") else set(ALTERNATIVES)
    for name in every:
        kind = name.removeprefix("-")
        if kind == "all":
            kinds = set() if name.startswith("-") else set(ALTERNATIVES)
            continue
        try:
            ALTERNATIVES.find(kind)
        except ConfigurationError as error:
            raise ConfigurationError(f"--alternatives {name}: {error}") from None
        kinds = kinds - {kind} if name.startswith("-") else kinds | {kind}
    return frozenset(kinds)
