"""Extended Kalman filters over all sections of the logs, in parallel: gains, innovations, smoothed disturbances."""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.prediction import (
    FilterCovariances,
    FilterData,
    FilterPass,
    FixedGainPrediction,
    Predictor,
)
from dualwinch.identification.options import EstimationOptions
from dualwinch.identification.predictor import (
    DISTURBANCES,
    NoiseCovariances,
    initial_state,
    parameter_names,
    state_template,
)
from dualwinch.identification.resample import LogSection
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.threads import run_all
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]


class LogFilters:
    """Extended Kalman filters, one a section; sections run on all cores.

    Attributes:
        sections: of the logs.
        passes: passes through the logs so far.
    """

    def __init__(
        self,
        predictor: Predictor,
        structure: Experiment,
        sections: Sequence[LogSection],
        options: EstimationOptions,
        threads: int | None = None,
    ) -> None:
        """Filters by a compiled predictor of some structure; `threads`: default one a core."""
        self.sections = tuple(sections)
        self.passes = 0
        self._predictor, self._structure, self._options, self._threads = predictor, structure, options, threads

    def parameters(self, experiment: Experiment, noise: NoiseCovariances) -> Floats:
        """The predictor's parameters, of an experiment and the disturbances' correlation times."""
        values = leaves(experiment) | {f"time.{name}": noise.process[name].time for name in DISTURBANCES}
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
        """Filter every section.

        Args:
            experiment: the machine.
            noise: R and Q.
            robust: whether outliers count less (``options.search.outlier``).
            samples: first samples of each section that are filtered; default: all.
            into: earlier passes over the same sections whose arrays may be overwritten.
            how: `gains`, `rows`, `watched` of `codegen.drivers.prediction.Predictor.filter`.
        """
        old = dict(zip(map(id, self.sections), into, strict=False))

        def filtered(section: LogSection) -> FilterPass:
            part = section.upto(samples) if samples else section
            return self._filtered(experiment, noise, part, robust=robust, into=old.get(id(section)), **how)

        return self._each(filtered)

    def _filtered(
        self, experiment: Experiment, noise: NoiseCovariances, section: LogSection, *, robust: bool = True, **how: Any
    ) -> FilterPass:
        data, initial = self.data(experiment, noise, section)
        covariances = FilterCovariances(initial, self.process_variances(experiment, noise), noise.measurement)
        outlier = self._options.search.outlier if robust else np.inf
        return self._predictor.filter(self.parameters(experiment, noise), data, covariances, outlier=outlier, **how)

    def deviances(self, experiments: Sequence[Experiment], noise: NoiseCovariances) -> Floats:
        """Minus twice the log-likelihood of all innovations, but for a constant, for each of some machines.

        Infinite where a filter diverges.
        """

        def deviance(experiment: Experiment, section: LogSection) -> float:
            filtered = self._filtered(experiment, noise, section, gains=False)
            return 2 * filtered.negative_log_likelihood if all_completed([filtered]) else np.inf

        jobs = [lambda pair=pair: deviance(*pair) for pair in product(experiments, self.sections)]
        self.passes += len(experiments)
        return np.array(self._all(jobs)).reshape(len(experiments), -1).sum(axis=1)

    def predict(
        self,
        parameters: Floats,
        experiment: Experiment,
        noise: NoiseCovariances,
        filtered: Sequence[FilterPass],
        *,
        rows: bool = False,
    ) -> list[FixedGainPrediction]:
        """Predict every section with given gains.

        Args:
            parameters: of `parameters`, in part replaced.
            experiment: gives the initial state.
            noise: likewise.
            filtered: gains of the sections.
            rows: whether innovations are kept.
        """
        numbered = dict(zip(map(id, self.sections), filtered, strict=True))

        def predicted(section: LogSection) -> FixedGainPrediction:
            data, _ = self.data(experiment, noise, section)
            return self._predictor.predict(parameters, data, numbered[id(section)], rows=rows)

        return self._each(predicted)

    def smooth(self, experiment: Experiment, noise: NoiseCovariances) -> list[tuple[Floats, Floats, Floats]]:
        """Estimate the disturbances in every section from all its readings.

        Returns:
            Of each section (samples, states) filtered states, (samples, disturbances) smoothed disturbances, and
            (samples, disturbances, disturbances) their covariances.
        """
        passes = self.run(experiment, noise, robust=False, rows=True, watched=len(DISTURBANCES))
        numbered = dict(zip(map(id, self.sections), passes, strict=True))
        parameters = self.parameters(experiment, noise)

        def smoothed(section: LogSection) -> tuple[Floats, Floats, Floats]:
            data, own = self.data(experiment, noise, section)[0], numbered[id(section)]
            return np.asarray(own.states), *self._predictor.smooth(parameters, data, own)

        return self._each(smoothed)

    def whitened_innovations(self, experiment: Experiment, noise: NoiseCovariances) -> list[Floats]:
        """(samples, readings) whitened innovations of each section; NaN where nothing was read."""
        filtered = self.run(experiment, noise, robust=False)
        predictions = self.predict(self.parameters(experiment, noise), experiment, noise, filtered, rows=True)
        return [each.innovations for each in predictions if each.innovations is not None]

    def data(self, experiment: Experiment, noise: NoiseCovariances, section: LogSection) -> tuple[FilterData, Floats]:
        """A section with its initial state, and the covariance of that."""
        first = np.full(section.readings.shape[1], np.nan)
        for column in range(len(first)):
            early = section.readings[: self._options.resampling.first_reading_samples, column]
            known = early[np.isfinite(early)]
            first[column] = known[0] if len(known) else np.nan
        start, covariance = initial_state(
            experiment,
            self._structure,
            first,
            (float(section.torques[0, 0]), float(section.torques[0, 1])),
            float(section.inputs[0, 0]),
            noise.process,
            self._options.initial_state,
        )
        return FilterData(section.inputs, section.readings, start), covariance

    def process_variances(self, experiment: Experiment, noise: NoiseCovariances) -> Floats:
        """The variances that a sample adds to the states, (states,)."""
        step, variances = experiment.simulation.sample_time, dict.fromkeys(leaves(state_template(self._structure)), 0.0)
        for name, each in noise.process.items():
            variances[f"unrecorded.{name}"] = each.deviation**2 * -np.expm1(-2 * step / each.time)
        return np.array(list(variances.values()))

    def _each(self, work: Callable[[LogSection], object]) -> list:
        self.passes += 1
        return self._all([lambda section=section: work(section) for section in self.sections])

    def _all(self, jobs: Sequence[Callable[[], object]]) -> list:
        found: list[object] = [None] * len(jobs)

        def run(index: int) -> None:
            found[index] = jobs[index]()

        if not run_all([lambda index=index: run(index) for index in range(len(found))], self._threads):
            raise KeyboardInterrupt
        return found


def all_completed(runs: Sequence[FilterPass | FixedGainPrediction]) -> bool:
    """Whether no filter left the track or diverged."""
    return all(run.outcome == Outcome.COMPLETED for run in runs)
