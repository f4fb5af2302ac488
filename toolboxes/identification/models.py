"""Models of logs: what is fitted, and what a fit of it says."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import Experiment
from dualwinch.toolboxes.identification.diagnostics import ImplausibleFitError, whiteness_tests
from dualwinch.toolboxes.identification.estimate import ParameterEstimate, PredictionErrorMethod
from dualwinch.toolboxes.identification.options import EstimationOptions
from dualwinch.toolboxes.identification.predictor import NoiseCovariances, RecordedExperiment, described_disturbances
from dualwinch.toolboxes.identification.resample import counting
from dualwinch.toolboxes.identification.unknowns import UnknownParameter, covariance_of

Floats = NDArray[np.float64]


def are_white(method: PredictionErrorMethod, experiment: Experiment, noise: NoiseCovariances) -> bool:
    """Whether innovations are white, except those of sensors that count in steps."""
    innovations = method.filters.whitened_innovations(experiment, noise)
    torques = [section.torques for section in method.filters.sections]
    tests = whiteness_tests(innovations, torques, method.options.diagnostics)
    return all(test.white for test in tests if test.name not in counting(experiment.sensors))


@dataclass(frozen=True)
class LogModel:
    """What is fitted to logs.

    Attributes:
        experiment: with all effects.
        options: of the method.
        kinds: of the alternatives to the experiment as described (`alternatives.Alternative`).
        nuisances: parameters that are estimated along, behind the requested ones.
        further: number of further parameters that were chosen by the logs.
    """

    experiment: Experiment
    options: EstimationOptions
    kinds: tuple[str, ...] = ()
    nuisances: tuple[UnknownParameter, ...] = ()
    further: int = 0

    def extended(
        self, kind: str, experiment: Experiment, nuisances: Sequence[UnknownParameter] = (), further: int = 0
    ) -> "LogModel":
        """The model with one more alternative; nuisance parameters replace those of the same keys."""
        keys = {each.key for each in nuisances}
        return replace(
            self,
            experiment=experiment,
            kinds=(*self.kinds, *([kind] if kind not in self.kinds else [])),
            nuisances=(*(each for each in self.nuisances if each.key not in keys), *nuisances),
            further=self.further + further,
        )

    def without(self, *kinds: str) -> "LogModel":
        """The model that no longer names some kinds; its experiment is unchanged."""
        return replace(self, kinds=tuple(kind for kind in self.kinds if kind not in kinds))


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A model with its estimate.

    Attributes:
        model: what was fitted.
        method: of the estimate; its unknowns are the requested parameters and, behind them, nuisance parameters.
        estimate: the best one.
        optima: estimates from other starts.
        refusal: why the estimate is implausible; ``None``: it is plausible.
        remarks: on a plausible estimate.
        rivals: models with considerable support, each with its criterion above this one's.
    """

    model: LogModel
    method: PredictionErrorMethod
    estimate: ParameterEstimate
    optima: tuple[ParameterEstimate, ...] = ()
    refusal: ImplausibleFitError | None = None
    remarks: tuple[str, ...] = ()
    rivals: "tuple[tuple[float, FittedModel], ...]" = ()

    @property
    def experiment(self) -> Experiment:
        """The experiment that was fitted, with its starting values."""
        return self.model.experiment

    @property
    def finished(self) -> bool:
        """Whether all searches for it went on to a maximum of the likelihood."""
        return all(each.finished for each in (self.estimate, *self.optima))

    @property
    def parameters(self) -> int:
        """Number of estimated parameters."""
        return len(self.method.unknowns) + self.model.further

    @property
    def readings(self) -> int:
        """Number of readings."""
        return sum(int(np.isfinite(section.readings).sum()) for section in self.method.filters.sections)

    @cached_property
    def white(self) -> bool:
        """Whether innovations are white (`are_white`)."""
        return are_white(self.method, self.estimate.experiment, self.estimate.noise)

    def information_criterion(self, deviance: float) -> float:
        """The Bayesian information criterion (Schwarz, Ann. Stat. 6 (1978) 461) of a deviance, priors included."""
        priors = self.method.coordinates()
        prior = priors.prior_deviance(priors.of(self.estimate.values))
        return deviance + prior + self.parameters * math.log(self.readings)

    @property
    def weights(self) -> list[float]:
        """Weights of this model and its rivals, by their criteria (Burnham and Anderson, Section 6.4)."""
        likelihoods = [1.0, *(math.exp(-above / 2) for above, _ in self.rivals)]
        return [each / sum(likelihoods) for each in likelihoods]

    def notes(self, described: Experiment) -> tuple[str, ...]:
        """Differences of the model from the described experiment, in words."""
        return tuple(self._notes(described))

    def _notes(self, described: Experiment) -> Iterator[str]:
        experiment, sea = self.experiment, described.disturbance
        step = experiment.simulation.sample_time
        if isinstance(experiment, RecordedExperiment):
            index = [each.key for each in self.method.unknowns].index("recorder.phase")
            deviation = math.sqrt(covariance_of(self.estimate.information, self.method.unknowns)[index, index])
            late = experiment.simulation.delay_samples * step - self.estimate.values[index]
            yield (
                "rows are interpolated between the controller's samples"
                if experiment.recorder.interpolated
                else "rows are between the controller's samples: torques act "
                f"{1e3 * late:.4g} ± {1e3 * deviation:.2g} ms after their row"
            )
        elif (delay := experiment.simulation.delay_samples) != described.simulation.delay_samples:
            yield (
                f"torques act {delay} samples after they are logged; simulation.delay_samples = "
                f"{described.simulation.delay_samples} stays as it is"
            )
        lag = self.estimate.experiment.sensors.load_cell_time_constant
        if lag and not described.sensors.load_cell_time_constant:
            yield (
                f"load cells lag by {1e3 * lag:.2g} ms, which the experiment does not describe "
                f"(sensors.load_cell_time_constant = {lag:.2g})"
            )
        for name, words in (("submerged_weight", "weight"), ("mass_per_length", "mass")):
            rope = experiment.plant.rope_1
            if getattr(described.plant.rope_1, name) and not getattr(rope, name, 0.0):
                yield f"ropes move as if they had no {words} (plant.rope_*.{name} = 0), unlike the described ones"
        if self.method.options.resampling.between_rows:
            yield (
                "torques changed more often than they were logged: between rows their mean over "
                f"{self.method.options.resampling.torque_rows} rows is used, and chatter is treated as noise"
            )
        additions = {
            "vortices (disturbance.vortex)": experiment.disturbance.vortex and not sea.vortex,
            "current (current_sigma)": experiment.disturbance.current_sigma > sea.current_sigma,
            "changes of the rail load (normal_force_sigma)": (
                experiment.disturbance.normal_force_sigma > sea.normal_force_sigma
            ),
        }
        if any(additions.values()):
            names = ", ".join(name for name, added in additions.items() if added)
            yield f"estimated with {names}, which the experiment does not describe"
        if experiment.disturbance.vortex and experiment.disturbance.integrated_phase != sea.integrated_phase:
            kind = (
                "is the integral of their frequency"
                if experiment.disturbance.integrated_phase
                else "follows from speed and time"
            )
            yield f"the phase of the vortices {kind} (disturbance.integrated_phase), unlike the experiment's"
        if self.rivals:
            yield (
                f"another model is almost as likely (weight {1 - self.weights[0]:.0%}), and estimates and deviations "
                "are averages of both"
            )
        yield from self._sea_of_another_size(described)
        yield from self._conflicts()

    def _conflicts(self) -> Iterator[str]:
        """A note on each nuisance parameter that contradicts its prior."""
        for each in self.model.nuisances:
            if self.contradicts(each.key):
                yield f"{self._far(each)}: it may stand for something that the model lacks"

    def _far(self, nuisance: UnknownParameter) -> str:
        value, prior = self.estimate.values[self._index(nuisance.key)], nuisance.prior
        expected = f"{prior.mean:.3g} ± {prior.deviation:.3g} {nuisance.unit}" if prior else ""
        return f"{nuisance.key} = {value:.4g} is far from what was expected, {expected}"

    def check_priors(self) -> None:
        """Refuse nuisance parameters that their priors make improbable (Box's prior predictive check).

        Raises:
            ImplausibleFitError: the probability of such an estimate is below `PlausibilityOptions.improbable`.
        """
        for each in self.model.nuisances:
            if self.prior_probability(each.key) < self.method.options.plausibility.improbable:
                raise ImplausibleFitError(
                    f"{self.method.filters.sections[0].name}: {self._far(each)}: it is of another machine; if not, "
                    f"describe {each.key} or estimate it (--fit {each.key})"
                )

    def _sea_of_another_size(self, described: Experiment) -> Iterator[str]:
        """A note on each described disturbance with a clearly different size in the logs."""
        options, vehicle = self.method.options.noise, described.plant.vehicle
        usual, factor = described_disturbances(described, options), math.sqrt(options.described_factor)
        names = {
            "current": ("current", 1.0, " m/s"),
            "normal_force_variation": ("normal_force", vehicle.normal_force, ""),
        }
        process = self.estimate.noise.process_of(self.estimate.experiment.plant.vehicle)
        for key, (name, by, unit) in names.items():
            estimate, expected = process[key], usual[key]
            if expected.deviation and not 1 / factor < estimate.deviation / expected.deviation < factor:
                yield (
                    f"disturbance.{name}_sigma = {expected.deviation / by:.3g}, {name}_time = {expected.time:.3g}: "
                    f"these logs show {estimate.deviation / by:.2g}{unit} and {estimate.time:.2g} s"
                )

    def along(self, count: int, factors: Floats) -> dict[str, tuple[float, float]]:
        """Value and standard deviation, times a factor of `factors`, of the unknowns behind the first `count`."""
        unknowns, estimate = self.method.unknowns, self.estimate
        deviations = factors * np.sqrt(np.diag(covariance_of(estimate.information, unknowns)))
        pairs = zip(estimate.values[count:].tolist(), deviations[count:].tolist(), strict=True)
        return {each.key: pair for each, pair in zip(unknowns[count:], pairs, strict=True)}

    def words(self, count: int) -> str:
        """Estimates of the first `count` unknowns, each with its standard deviation, in a line."""
        unknowns, estimate = self.method.unknowns, self.estimate
        deviations = np.sqrt(np.diag(covariance_of(estimate.information, unknowns)))
        triples = zip(unknowns[:count], estimate.values.tolist(), deviations.tolist(), strict=False)
        return ", ".join(f"{each.key} = {value:.4g} ± {deviation:.2g}" for each, value, deviation in triples)

    def averaged(self, values: Floats, covariance: Floats, by_sheets: Floats) -> tuple[Floats, Floats]:
        """(n,) values and (n, n) covariance of the first unknowns, averaged over this model and its rivals.

        A part of the covariance is by data sheets, and the same for all of them. With weights, the average does not
        hang on which of two close models is chosen (Burnham and Anderson, Model Selection and Multimodel Inference,
        2002, Section 4.3).
        """
        n, means, spreads = len(values), [values], [covariance]
        for _, rival in self.rivals:
            information = marginal(rival.estimate.information, rival.method.unknowns, n)
            means.append(rival.estimate.values[:n])
            spreads.append(covariance_of(information, rival.method.unknowns[:n]) + by_sheets)
        mean = np.average(means, axis=0, weights=self.weights)
        around = [spread + np.outer(each - mean, each - mean) for each, spread in zip(means, spreads, strict=True)]
        return mean, np.average(around, axis=0, weights=self.weights)

    def _index(self, key: str) -> int:
        return [each.key for each in self.method.unknowns].index(key)

    def conflict(self, key: str) -> float:
        """Distance of an estimate from its prior's mean, in deviations of the prior prediction of that estimate.

        That has the variance of the prior less that of the estimate (Box, J. R. Stat. Soc. A 143 (1980) 383); 0: no
        prior, or the logs say nothing on it.
        """
        index = self._index(key)
        prior = self.method.unknowns[index].prior
        variance = covariance_of(self.estimate.information, self.method.unknowns)[index, index]
        if prior is None or variance >= prior.deviation**2:
            return 0.0
        return abs(self.estimate.values[index] - prior.mean) / math.sqrt(prior.deviation**2 - variance)

    def prior_probability(self, key: str) -> float:
        """Probability of an estimate that is at least as far from its prior's mean, by the prior prediction."""
        return math.erfc(self.conflict(key) / math.sqrt(2))

    def contradicts(self, key: str) -> bool:
        """Whether an estimate contradicts its prior, at the confidence of the tests."""
        return self.prior_probability(key) < 1 - self.method.options.diagnostics.confidence

    def is_significant(self, key: str) -> bool:
        """Whether an estimate differs from zero, at that confidence."""
        index = self._index(key)
        variance = covariance_of(self.estimate.information, self.method.unknowns)[index, index]
        probability = math.erfc(abs(self.estimate.values[index]) / math.sqrt(2 * variance))
        return probability < 1 - self.method.options.diagnostics.confidence


@dataclass(frozen=True)
class ModelEvidence:
    """A fitted model beside the others.

    Attributes:
        alternatives: kinds of its alternatives to the experiment as described; none: that experiment.
        parameters: number of estimated parameters, the requested ones included.
        deviance: minus twice the log-likelihood above that of the likeliest.
        criterion: Bayesian information criterion above the least.
        weight: by which it counts in the average.
        refusal: why it is implausible; empty: it is plausible.
    """

    alternatives: tuple[str, ...]
    parameters: int
    deviance: float
    criterion: float
    weight: float
    refusal: str = ""


def marginal(information: Floats, unknowns: Sequence[UnknownParameter], n: int) -> Floats:
    """(n, n) marginal information on the first n unknowns; the others are known by their priors only."""
    rest = information[n:, n:] + np.diag([1 / each.uncertainty**2 for each in unknowns[n:]])
    return information[:n, :n] - information[:n, n:] @ np.linalg.solve(rest, information[n:, :n])
