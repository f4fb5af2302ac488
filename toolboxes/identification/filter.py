"""Extended Kalman filters over all sections of the logs, in parallel: gains, innovations, smoothed disturbances."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import Experiment, compiled, executors, leaves, structures
from dualwinch.toolboxes.identification.options import EstimationOptions
from dualwinch.toolboxes.identification.prediction import (
    FilterCovariances,
    FilterData,
    FilterPass,
    FixedGainPrediction,
    Predictor,
)
from dualwinch.toolboxes.identification.predictor import (
    DISTURBANCES,
    NoiseCovariances,
    initial_state,
    parameter_names,
    state_names,
    state_template,
)
from dualwinch.toolboxes.identification.resample import LogSection

Floats = NDArray[np.float64]

Found = TypeVar("Found")


STRETCH = 1 << 14
"""Samples of which innovations are held in memory for all candidates of a step of scoring."""


class LogFilters:
    """Extended Kalman filters, one per section; sections run in parallel.

    Attributes:
        sections: of the logs.
        passes: number of passes through the logs so far.
    """

    def __init__(
        self,
        predictor: Predictor,
        structure: structures.LoopStructure,
        sections: Sequence[LogSection],
        options: EstimationOptions,
        threads: int | None = None,
    ) -> None:
        """Set up with a compiled predictor of a structure; `threads`: default one per core."""
        self.sections = tuple(sections)
        self.passes = 0
        self._predictor, self._structure, self._options, self._threads = predictor, structure, options, threads

    def parameters(self, experiment: Experiment, noise: NoiseCovariances) -> Floats:
        """The predictor's parameters, from an experiment and the disturbances' correlation times."""
        values = leaves(experiment) | {f"time.{name}": each.time for name, each in noise.process.items()}
        return np.array([float(values[name]) for name in parameter_names(self._structure)])

    def run(
        self,
        experiment: Experiment,
        noise: NoiseCovariances,
        *,
        robust: bool = True,
        samples: int | None = None,
        into: Sequence[FilterPass] = (),
        **how: Any,
    ) -> list[FilterPass]:
        """Filter every section, or only its first `samples`.

        A robust filter down-weights outliers (``options.search.outlier``). Passes given as `into` are overwritten.
        Further arguments are `gains`, `rows` and `watched` of `prediction.Predictor.filter`.
        """
        known = [*into, *[None] * (len(self.sections) - len(into))]

        def filtered(section: LogSection, into: FilterPass | None) -> FilterPass:
            part = section.upto(samples) if samples else section
            return self._filtered(experiment, noise, part, robust=robust, into=into, **how)

        return self._each(filtered, known)

    def _filtered(
        self, experiment: Experiment, noise: NoiseCovariances, section: LogSection, *, robust: bool = True, **how: Any
    ) -> FilterPass:
        data, initial = self.data(experiment, noise, section)
        covariances = FilterCovariances(initial, self.process_variances(experiment, noise), noise.measurement)
        outlier = self._options.search.outlier if robust else np.inf
        return self._predictor.filter(self.parameters(experiment, noise), data, covariances, outlier=outlier, **how)

    def deviances(
        self, candidates: Sequence[tuple[Experiment, NoiseCovariances]], samples: int | None = None
    ) -> Floats:
        """Minus twice the log-likelihood of all innovations, up to a constant, for each of several machines with noise.

        Infinite if a filter diverges; `samples` as in `run`.
        """

        def deviance(candidate: tuple[Experiment, NoiseCovariances], section: LogSection) -> float:
            filtered = self._filtered(*candidate, section.upto(samples) if samples else section, gains=False)
            return 2 * filtered.negative_log_likelihood if all_completed([filtered]) else np.inf

        pairs = list(product(candidates, self.sections))
        self.passes += len(candidates)
        found = executors.map_all(lambda pair: deviance(*pair), pairs, self._threads)
        return np.array(found).reshape(len(candidates), -1).sum(axis=1)

    def scoring(self, candidates: Sequence[tuple[Experiment, NoiseCovariances]], sizes: Floats) -> Floats | None:
        """(m + 1, m + 1) normal equations of a step of Fisher scoring; ``None`` if a filter diverges.

        The first candidate is a machine with noise; each of the m others differs from it by its one of `sizes` in one
        coordinate. Without the last row and column they are the expected information on the coordinates; the last
        column is half the slope of the deviance (N. K. Gupta and R. K. Mehra, IEEE Trans. Automatic Control 19 (1974)
        774). Derivatives of the innovations and their variances are by differences; outliers, whose squares grow
        linearly, count less (iteratively reweighted least squares).
        """
        normal, outlier = np.zeros((len(candidates),) * 2), self._options.search.outlier
        parameters = [self.parameters(*each) for each in candidates]
        walks = [self.process_variances(*each) for each in candidates]
        self.passes += len(candidates)
        for section in self.sections:
            starts = [self.data(*each, section) for each in candidates]
            beliefs = [(data.start, covariance) for data, covariance in starts]
            for begin in range(0, len(section.inputs), STRETCH):
                inputs, readings = (each[begin : begin + STRETCH] for each in (section.inputs, section.readings))
                arguments = [
                    (
                        own,
                        FilterData(inputs, readings, mean),
                        FilterCovariances(covariance, walk, noise.measurement),
                    )
                    for own, (mean, covariance), walk, (_, noise) in zip(
                        parameters, beliefs, walks, candidates, strict=True
                    )
                ]
                filtered = partial(self._predictor.filter, outlier=outlier, gains=False, updates=True)
                runs = executors.map_all(lambda each, by=filtered: by(*each), arguments, self._threads)
                if not all_completed(runs):
                    return None
                normal += _scores([each.updates for each in runs if each.updates is not None], sizes, outlier)
                beliefs = [each.end for each in runs if each.end is not None]
        return normal

    def predict(
        self,
        parameters: Floats,
        experiment: Experiment,
        noise: NoiseCovariances,
        filtered: Sequence[FilterPass],
        *,
        rows: bool = False,
    ) -> list[FixedGainPrediction]:
        """Predict every section with given gains; experiment and noise determine the initial states.

        Parameters are in the order of `parameters`; with `rows` the innovations are kept.
        """

        def predicted(section: LogSection, own: FilterPass) -> FixedGainPrediction:
            data, _ = self.data(experiment, noise, section)
            return self._predictor.predict(parameters, data, own, rows=rows)

        return self._each(predicted, filtered)

    def smooth(self, experiment: Experiment, noise: NoiseCovariances) -> list[tuple[Floats, Floats, Floats]]:
        """Estimate the disturbances in every section from all its readings.

        Returns:
            For each section (samples, states) filtered states, (samples, disturbances) smoothed disturbances, and
            (samples, disturbances, disturbances) their covariances.
        """
        passes = self.run(experiment, noise, robust=False, rows=True, watched=len(DISTURBANCES))
        parameters = self.parameters(experiment, noise)

        def smoothed(section: LogSection, own: FilterPass) -> tuple[Floats, Floats, Floats]:
            data, _ = self.data(experiment, noise, section)
            return np.asarray(own.states), *self._predictor.smooth(parameters, data, own)

        return self._each(smoothed, passes)

    def whitened_innovations(self, experiment: Experiment, noise: NoiseCovariances) -> list[Floats]:
        """(samples, readings) whitened innovations of each section; NaN without a reading."""
        filtered = self.run(experiment, noise, robust=False)
        predictions = self.predict(self.parameters(experiment, noise), experiment, noise, filtered, rows=True)
        return [each.innovations for each in predictions if each.innovations is not None]

    def data(self, experiment: Experiment, noise: NoiseCovariances, section: LogSection) -> tuple[FilterData, Floats]:
        """A section with its initial state, and the covariance of the state."""
        early = section.readings[: round(self._options.resampling.window / experiment.simulation.sample_time)]
        first = early[np.isfinite(early).argmax(axis=0), np.arange(early.shape[1])]
        start, covariance = initial_state(
            experiment,
            self._structure,
            first,
            (float(section.torques[0, 0]), float(section.torques[0, 1])),
            float(section.inputs[0, 0]),
            noise.states,
            self._options.initial_state,
        )
        return FilterData(section.inputs, section.readings, start), covariance

    def process_variances(self, experiment: Experiment, noise: NoiseCovariances) -> Floats:
        """(states,) variances that process noise adds to the states per sample."""
        step, variances = experiment.simulation.sample_time, dict.fromkeys(leaves(state_template(self._structure)), 0.0)
        for name, each in noise.states.items():
            added = each.deviation**2 * -np.expm1(-2 * step / each.time)
            variances |= {state: added for state in state_names(name) if state in variances}
        return np.array(list(variances.values()))

    def _each(self, work: Callable[[LogSection, Any], Found], along: Sequence[Any]) -> list[Found]:
        """The results of some work on every section with its element of `along`, in parallel."""
        self.passes += 1
        return executors.map_all(lambda pair: work(*pair), list(zip(self.sections, along, strict=True)), self._threads)


def all_completed(runs: Sequence[FilterPass | FixedGainPrediction]) -> bool:
    """Whether no filter left the track or diverged."""
    return all(run.outcome == compiled.Outcome.COMPLETED for run in runs)


def deviance_of(filtered: Sequence[FilterPass]) -> float:
    """Minus twice the log-likelihood of the innovations of all sections, up to a constant."""
    return 2 * sum(each.negative_log_likelihood for each in filtered)


def _scores(updates: Sequence[Floats], sizes: Floats, outlier: float) -> Floats:
    """Products of `LogFilters.scoring` over some samples, from the `FilterPass.updates` of all candidates."""
    read = np.isfinite(updates[0][..., 1])
    first, *others = [each[read] for each in updates]
    innovations, variances = first.T
    deviations = np.sqrt(variances)
    white = innovations / deviations
    roots = np.sqrt(np.where(abs(white) > outlier, outlier / (2 * np.maximum(abs(white), outlier)), 1.0))
    rows = np.empty((len(updates), 2, len(white)))
    rows[-1] = roots * white, (1 - (roots * white) ** 2) / (np.sqrt(2) * roots)
    for row, other, size in zip(rows, others, sizes.tolist(), strict=False):
        row[0] = roots * (other[:, 0] - innovations) / deviations / size
        row[1] = roots * np.log(other[:, 1] / variances) / (np.sqrt(2) * size)
    flat = rows.reshape(len(updates), -1)
    return flat @ flat.T
