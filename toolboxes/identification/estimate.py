"""The prediction-error method: maximise the likelihood of the innovations from a start.

L. Ljung, System Identification, 2nd ed., Section 7; N. R. Kristensen, H. Madsen and S. B. Jørgensen, Automatica 40
(2004) 225, for filters with unrecorded disturbances.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Controller,
    Experiment,
    executors,
    progresses,
    structures,
    with_leaves,
)
from dualwinch.toolboxes.identification.filter import LogFilters, all_completed, deviance_of
from dualwinch.toolboxes.identification.likelihood import Likelihood, LikelihoodMaximum
from dualwinch.toolboxes.identification.noise import NoiseEstimator, initial_measurement_noise
from dualwinch.toolboxes.identification.options import DEFAULTS, EstimationOptions
from dualwinch.toolboxes.identification.prediction import FilterPass, compile_predictor
from dualwinch.toolboxes.identification.predictor import (
    READINGS,
    NoiseCovariances,
    described_disturbances,
    parameter_names,
    predicted_system,
    predictor_structure,
)
from dualwinch.toolboxes.identification.resample import LogSection
from dualwinch.toolboxes.identification.unknowns import (
    SearchCoordinates,
    UnknownParameter,
    covariance_of,
    data_sheet_parameters,
    unwrapped,
)

Floats = NDArray[np.float64]

Found = TypeVar("Found")


class DivergedFilterError(ConfigurationError):
    """Filters diverge at the start of a search."""


@dataclass(frozen=True)
class ParameterEstimate:
    """A maximum of the likelihood.

    Attributes:
        values: (p,) of the unknowns.
        information: (p, p) of the logs alone, without priors.
        noise: R and Q.
        experiment: with these values.
        deviance: minus twice the log-likelihood, up to a constant.
        rough: the deviance after least squares, before it was maximised.
        finished: whether it was.
        passes: number of passes through the logs so far.
        converged: whether no neighbour at `SearchOptions.accuracy` standard deviations is likelier, with this noise.
    """

    values: Floats
    information: Floats
    noise: NoiseCovariances
    experiment: Experiment
    deviance: float
    rough: float
    finished: bool
    passes: int
    converged: bool


def _with_values(experiment: Experiment, keys: Sequence[str], values: Floats) -> Experiment:
    """The experiment with other values of the unknowns."""
    return with_leaves(experiment, dict(zip(keys, values.tolist(), strict=True)))


class PredictionErrorMethod:
    """Maximum likelihood of the innovations of extended Kalman filters.

    1. If the filters diverge at the start, increase process noise Q until they do not.
    2. Rounds of least squares: with fixed gains of the filters, the whitened innovations are a least-squares problem
       with exact derivatives. Solve it and filter again until values are near the optimum. In the first rounds,
       parameters with a prior stay near it; afterwards Q (by maximum likelihood) and R (by expectation maximisation)
       are estimated too.
    3. To a local maximum of the likelihood over values and noise (`Likelihood.maximum`).
    """

    def __init__(
        self,
        sections: Sequence[LogSection],
        experiment: Experiment,
        unknowns: Sequence[UnknownParameter],
        options: EstimationOptions = DEFAULTS,
        threads: int | None = None,
    ) -> None:
        """Set up for given sections and unknowns; compiles the filter."""
        self.unknowns, self.options = tuple(unknowns), options
        self.made_of = sections, experiment, self.unknowns, options
        self._experiment, self._search, self.threads = experiment, options.search, threads
        keys, self.structure = tuple(unknown.key for unknown in unknowns), predictor_structure(experiment)
        zeros = structures.zeros_of(
            self.structure, structures.parameters_of(replace(experiment, controller=Controller())), varying=keys
        )
        self._predictor = compile_predictor(predicted_system(self.structure, keys, zeros))
        self.filters = self.filters_of(sections)
        columns = [parameter_names(self.structure).index(key) for key in keys]
        self.with_values = partial(_with_values, experiment, keys)  # a bound method would keep logs alive in a cycle
        self.likelihood = Likelihood(self.filters, self.with_values, columns, options.search)
        self._noise = NoiseEstimator(self.filters, experiment, options.noise)

    @property
    def passes(self) -> int:
        """Number of passes through the logs so far."""
        return self.filters.passes

    @property
    def samples(self) -> int:
        """Number of samples of the logs."""
        return sum(len(section.readings) for section in self.filters.sections)

    def filters_of(self, sections: Sequence[LogSection]) -> LogFilters:
        """Filters over other sections."""
        return LogFilters(self._predictor, self.structure, sections, self.options, self.threads)

    def initial_noise(self) -> NoiseCovariances:
        """Initial R and Q."""
        readings = np.concatenate([section.readings for section in self.filters.sections])
        variances = initial_measurement_noise(readings, self._experiment, self.options.noise)
        process = described_disturbances(self._experiment, self.options.noise)
        return NoiseCovariances(variances, process, self._experiment.plant.vehicle)

    def coordinates(self, within: float = np.inf, itself: int | None = None) -> SearchCoordinates:
        """Coordinates of the unknowns; arguments as in `SearchCoordinates`."""
        return SearchCoordinates(self.unknowns, within, itself)

    def information(self, values: Floats) -> Floats | None:
        """(p, p) information of the logs at given values with the initial noise; ``None`` if filters diverge."""
        noise = self.initial_noise()
        filtered = self.likelihood.filtered(values, noise)
        if not all_completed(filtered):
            return None
        normal = self.likelihood.normal(values, noise, filtered)
        return normal[:-1, :-1] if np.isfinite(normal).all() else None

    def considered_information(self, values: Floats, noise: NoiseCovariances, estimated: Floats) -> Floats:
        """(p, p) information of the logs where the last unknowns are considered, not estimated.

        That of the `estimated` first ones is known. With the least information on the others that is possible, the
        covariance is that with these known, and their propagated priors besides.
        """
        information = self.likelihood.normal(values, noise, self.likelihood.filtered(values, noise))[:-1, :-1]
        count = len(estimated)
        priors = np.diag([1 / each.uncertainty**2 for each in self.unknowns[:count]])
        moves = np.linalg.solve(information[:count, :count] + priors, information[:count, count:])
        across = (estimated + priors) @ moves
        information[:count, :count], information[count:, count:] = estimated, moves.T @ across
        information[:count, count:], information[count:, :count] = across, across.T
        return information

    def noise_at(self, values: Floats) -> NoiseCovariances:
        """Initial R, and Q from a rough search, at given values."""
        return self._noise.with_process_noise(self.with_values(values), self.initial_noise(), anywhere=True)

    def deviance(self, values: Floats, noise: NoiseCovariances | None = None) -> float:
        """Minus twice the log-likelihood at given values; default noise: that of a rough search (`noise_at`)."""
        return float(self.filters.deviances([(self.with_values(values), noise or self.noise_at(values))])[0])

    def run(
        self,
        start: Floats,
        progress: progresses.Progress = progresses.no_progress,
        noise: NoiseCovariances | None = None,
        *,
        unless: Callable[[Experiment, NoiseCovariances, float], bool] | None = None,
        polished: bool = True,
    ) -> ParameterEstimate:
        """Search from a start.

        It begins at (p,) values. R and Q are estimated unless given as `noise`. If `unless` holds for the experiment,
        the noise and the deviance after least squares, it ends there; unless `polished`, at one standard deviation.

        Raises:
            DivergedFilterError: the filter diverges: the log is of another machine.
            ConfigurationError: a parameter without a prior has no effect at all.
        """
        estimated = noise is None
        noise = noise or self.initial_noise()
        if estimated and not all_completed(self.likelihood.filtered(start, noise)):
            noise = self._noise.tolerable(self.with_values(start), noise)
        if not all_completed(self.likelihood.filtered(start, noise)):
            raise self._diverged()
        if estimated and self.options.resampling.between_rows and not self._has_speed:
            noise = self._noise.with_torque_noise(self.with_values(start), noise)  # chatter is far from its least size
        values, noise = self._least_squares_rounds(start, noise, estimated, progress)
        coordinates = self.coordinates()
        rough = float(self.likelihood.deviances([coordinates.of(values)], noise, coordinates)[0])
        if unless and unless(self.with_values(values), noise, rough):
            information = self.likelihood.normal(values, noise, self.likelihood.filtered(values, noise))[:-1, :-1]
            return ParameterEstimate(
                values=values,
                information=information,
                noise=noise,
                experiment=self.with_values(values),
                deviance=rough,
                rough=rough,
                finished=False,
                passes=self.passes,
                converged=False,
            )
        later = progresses.part(progress, 0.5, 1.0)
        maximum = self._maximum(values, noise, later, estimated=estimated, polished=polished)
        return self._estimate(maximum, rough)

    def continued(
        self,
        start: Floats,
        noise: NoiseCovariances,
        progress: progresses.Progress = progresses.no_progress,
        *,
        polished: bool = True,
    ) -> ParameterEstimate:
        """The maximum of the likelihood near values, with the noise there as start of its estimation.

        Unless `polished`, it ends at one standard deviation.

        Raises:
            DivergedFilterError: the filter diverges.
        """
        maximum = self._maximum(start, noise, progress, size=1.0 if polished else None, polished=polished)
        return self._estimate(maximum, maximum.deviance)

    def _estimate(self, maximum: LikelihoodMaximum, rough: float) -> ParameterEstimate:
        values = unwrapped(self.coordinates().values(maximum.at), self.unknowns)
        return ParameterEstimate(
            values=values,
            information=maximum.information,
            noise=maximum.noise,
            experiment=self.with_values(values),
            deviance=maximum.deviance,
            rough=rough,
            finished=True,
            passes=self.passes,
            converged=maximum.converged,
        )

    def _diverged(self) -> DivergedFilterError:
        name = self.filters.sections[0].name
        return DivergedFilterError(f"{name}: no machine near the experiment's explains this log (the filter diverges)")

    def _least_squares_rounds(
        self, values: Floats, noise: NoiseCovariances, estimated: bool, progress: progresses.Progress
    ) -> tuple[Floats, NoiseCovariances]:
        """Values and noise near the optimum, by least squares with new gains in every round."""
        search = self._search
        cautious, anywhere = self.coordinates(search.reach), self.coordinates()
        filtered, last, before = self.likelihood.filtered(values, noise), np.zeros(len(values)), np.inf
        deviances, found_in_rounds = list[float](), list[tuple[Floats, NoiseCovariances]]()
        for number in range(search.max_iterations):
            progress(number / (number + 6) / 2)  # some ten rounds are usual
            coordinates = cautious if number < search.cautious_rounds else anywhere
            found, information = self.likelihood.solve_with_gains(values, noise, filtered, coordinates)
            if number == 0:
                self._check_effects(information)
            variances = np.diag(covariance_of(information, self.unknowns))
            if not (variances > 0).all():  # derivatives that grew without limit, as when a rope slackens
                break
            deviation = np.sqrt(variances)
            move = (unwrapped(found, self.unknowns) - values) / deviation
            moved = float(np.max(np.abs(move), initial=0.0))
            there = values + deviation * damped(move, last)
            if estimated and number >= search.cautious_rounds:
                experiment, first = self.with_values(there), number == search.cautious_rounds
                noise = self._noise.with_sea(experiment, noise) if first else noise
                noise = self._noise.with_process_noise(experiment, noise, anywhere=first)
            there, filtered = self._backtracked(values, there, noise, moved)
            if not all_completed(filtered):
                break
            values, last = there, move
            if number >= search.cautious_rounds:
                deviances.append(deviance_of(filtered))
                found_in_rounds.append((values, noise))
                likeliest = int(np.argmin(deviances))
                if likeliest < len(deviances) - search.cautious_rounds:  # there is no such machine
                    return found_in_rounds[likeliest]
                if estimated and moved < search.reach:  # not with Q at its least
                    noise = self._noise.with_measurement_noise(self.with_values(values), noise, filtered)
            near = moved < 1 or (before < search.reach and moved > before / 2)
            if near and not (estimated and number < search.cautious_rounds):  # not with Q at its least
                break
            before = moved
        return values, noise

    def _maximum(
        self,
        values: Floats,
        noise: NoiseCovariances,
        progress: progresses.Progress,
        size: float | None = None,
        *,
        estimated: bool = True,
        polished: bool = True,
    ) -> LikelihoodMaximum:
        """The maximum of the likelihood near values; over the noise, too, if that is `estimated`.

        It is accurate to one standard deviation, or `polished` to `SearchOptions.accuracy`; `size` as in
        `Likelihood.maximum`.

        Raises:
            DivergedFilterError: the filter diverges.
        """
        coordinates = self.coordinates()
        maximum = self.likelihood.maximum(
            coordinates.of(values),
            noise,
            coordinates,
            size=size,
            accuracy=None if polished else 1.0,
            around=self._noise.coordinates if estimated else None,
            progress=progress,
        )
        if maximum is None:
            raise self._diverged()
        return maximum

    @property
    def _has_speed(self) -> bool:
        """Whether any speed of the vehicle is recorded, which separates chatter from an unrecorded force."""
        column = READINGS.index("v")
        return any(np.isfinite(section.readings[:, column]).any() for section in self.filters.sections)

    def _backtracked(
        self, here: Floats, there: Floats, noise: NoiseCovariances, moved: float
    ) -> tuple[Floats, list[FilterPass]]:
        """Halve the way from `here` to `there`, `moved` deviations, while filters diverge and it is not negligible.

        Returns:
            The values, and passes with them.
        """
        filtered = self.likelihood.filtered(there, noise)
        while not all_completed(filtered) and moved > self._search.accuracy:
            there, moved = (here + there) / 2, moved / 2
            filtered = self.likelihood.filtered(there, noise)
        return there, filtered

    def _check_effects(self, information: Floats) -> None:
        for unknown, own in zip(self.unknowns, np.diag(information).tolist(), strict=True):
            if own == 0 and not unknown.prior:
                raise ConfigurationError(
                    f"--fit {unknown.key}: nothing in these logs depends on it: other values switch it off, or its "
                    "sensor was not recorded"
                )


def damped(move: Floats, last: Floats) -> Floats:
    """A move, shortened if it reverses the last one (Aitken's extrapolation).

    New gains may move a fit from one side of its optimum to the other. If each move is r times the one before, their
    sum is 1 / (1 - r) times this one.
    """
    ratio = float(move @ last) / max(float(last @ last), np.finfo(float).tiny)
    return move / (1 - np.clip(ratio, -1.0, 0.0))


@dataclass(frozen=True)
class LocalOptimum:
    """A local optimum at which one or more searches converged.

    Attributes:
        values: (p,) of the unknowns.
        deviance: above that of the best optimum.
        searches: number of searches that converged there.
    """

    values: tuple[float, ...]
    deviance: float
    searches: int


def with_data_sheets(
    method: PredictionErrorMethod, estimate: ParameterEstimate, readings: Collection[str], *, calibrated: bool
) -> tuple[PredictionErrorMethod, ParameterEstimate]:
    """The estimate with gains, zeros and scales by data sheets behind the method's own unknowns, and its method.

    Logs calibrate sensors and motors, too, if `calibrated`: these are nuisance parameters with priors
    (`unknowns.data_sheet_parameters`; `readings` are recorded). A model that lacks something would attribute that to
    them. Without, they are as described, and their errors are considered only in the deviations of the others: consider
    analysis (Tapley, Schutz and Born, Statistical Orbit Determination, 2004, Chapter 6).
    """
    sections, experiment, unknowns, options = method.made_of
    sheet = data_sheet_parameters([each.key for each in unknowns], experiment, readings, options)
    if not (sheet and calibrated):
        estimate = method.continued(estimate.values, estimate.noise)
    if not sheet:
        return method, estimate
    wider = PredictionErrorMethod(sections, experiment, (*unknowns, *sheet), options, method.threads)
    wider.filters.passes += method.passes
    values = np.array([*estimate.values, *(each.start for each in sheet)])
    if calibrated:
        return wider, wider.continued(values, estimate.noise)
    information = wider.considered_information(values, estimate.noise, estimate.information)
    return wider, replace(estimate, values=values, information=information)


def multistart(
    method: PredictionErrorMethod,
    first: ParameterEstimate,
    drawn: int,
    starts: int,
    seed: int,
    progress: progresses.Progress,
    workers: executors.Workers = None,
) -> list[ParameterEstimate]:
    """Estimates from several starts of the first `drawn` unknowns (`starts_of`), the likeliest first.

    The first start led to `first`; all other unknowns have the same starts. An executor's workers search in parallel.
    """
    others = [unknown.start for unknown in method.unknowns[drawn:]]
    further = [np.array([*own, *others]) for own in starts_of(method.unknowns[:drawn], starts, seed)[1:]]
    searches = _searches(method, further, progresses.part(progress, 1 / starts, 1.0), workers)
    found = [first, *(estimate for estimate in searches if isinstance(estimate, ParameterEstimate))]
    return sorted(found, key=lambda estimate: estimate.deviance)


def _searches(
    method: PredictionErrorMethod, starts: Sequence[Floats], progress: progresses.Progress, workers: executors.Workers
) -> Iterator[ParameterEstimate | ConfigurationError]:
    """The result of a search from each start; an error if the filter diverges there."""
    if isinstance(workers, Executor):
        tasks = ((_search, method.made_of, start) for start in starts)
        for number, found in enumerate(executors.in_order(executors.spread(workers, on_worker, tasks))):
            progress((number + 1) / len(starts))
            if isinstance(found, ParameterEstimate):
                method.filters.passes += found.passes
            yield found
        return
    for number, start in enumerate(starts):
        yield _search(method, start, progresses.part(progress, number / len(starts), (number + 1) / len(starts)))


def _search(
    method: PredictionErrorMethod, start: Floats, progress: progresses.Progress = progresses.no_progress
) -> ParameterEstimate | ConfigurationError:
    try:
        return method.run(start, progress)
    except ConfigurationError as error:
        return error


def on_worker(work: Callable[..., Found], made_of: tuple[Any, ...], *arguments: Any) -> Found:
    """Some work with a method, made anew on one thread of a worker from that of `PredictionErrorMethod.made_of`."""
    return work(PredictionErrorMethod(*made_of, threads=1), *arguments)


def starts_of(unknowns: Sequence[UnknownParameter], count: int, seed: int) -> list[Floats]:
    """Starts: the unknowns' own, then draws from their priors or, without a prior, between half and twice their own."""
    drawn, starts = np.random.default_rng(seed), [np.array([unknown.start for unknown in unknowns])]
    for _ in range(count - 1):
        moved = [
            drawn.normal(unknown.prior.mean, unknown.prior.deviation)
            if unknown.prior
            else unknown.start * 2 ** drawn.uniform(-1, 1)
            if unknown.start
            else drawn.uniform(-1, 1) * unknown.scale
            for unknown in unknowns
        ]
        starts.append(np.clip(moved, [each.lower for each in unknowns], [each.upper for each in unknowns]))
    return starts


def distinct_optima(estimates: Sequence[ParameterEstimate], covariance: Floats) -> tuple[LocalOptimum, ...]:
    """The distinct optima of estimates in order of likelihood, the first of which has the given (p, p) covariance.

    Two are distinct if a parameter differs by more than a standard deviation.
    """
    deviations, distinct = np.sqrt(np.diag(covariance)), list[LocalOptimum]()
    for estimate in estimates:
        for index, other in enumerate(distinct):
            if np.max(np.abs(estimate.values - other.values) / deviations) <= 1:
                distinct[index] = LocalOptimum(other.values, other.deviance, other.searches + 1)
                break
        else:
            above = estimate.deviance - estimates[0].deviance
            distinct.append(LocalOptimum(tuple(estimate.values.tolist()), above, 1))
    return tuple(distinct)
