"""Sections of logs, each with a start of its own, that filters go through side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from dualwinch.identification.course import samples_of
from dualwinch.identification.levels import Levels
from dualwinch.identification.log import Log
from dualwinch.identification.predictor import MachineState, parameter_names, state_template
from dualwinch.identification.rest import stretches
from dualwinch.identification.start import starting
from dualwinch.identification.unrecorded import NAMES
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.threads import run_all
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import Structure

Floats = NDArray[np.float64]

LOOK = 50
"""Samples in which the first reading of every sensor is looked for."""


@dataclass(frozen=True)
class Section:
    """A section of a log: inputs (samples, 4) and readings (samples, readings)."""

    name: str
    inputs: Floats
    readings: Floats

    @property
    def torques(self) -> Floats:
        """(samples, 2) commands in N m."""
        return self.inputs[:, 1:3]

    def upto(self, samples: int) -> "Section":
        """Its first samples."""
        return replace(self, inputs=self.inputs[:samples], readings=self.readings[:samples])


def sections_of(logs: Sequence[Log], experiment: Experiment) -> tuple[Section, ...]:
    """All logs on samples, stretch by stretch under way.

    They are not cut further: what acted on a machine at the end of a section and at the beginning of the next is the
    same, and a filter that begins anew would take it for news.

    Raises:
        ConfigurationError: as `identification.course.samples_of`.
    """
    found: list[Section] = []
    for log in logs:
        inputs, readings = samples_of(log, experiment)
        under_way = stretches(readings, experiment)
        found.extend(_section(log, inputs[stretch], readings[stretch]) for stretch in under_way)
    return tuple(found)


def whole_section(log: Log, experiment: Experiment) -> Section:
    """All of a log.

    Raises:
        ConfigurationError: as `identification.course.samples_of`.
    """
    return _section(log, *samples_of(log, experiment))


def _section(log: Log, inputs: Floats, readings: Floats) -> Section:
    return Section(log.name, np.ascontiguousarray(inputs), np.ascontiguousarray(readings))


class Filters:
    """The filters of all sections, on all cores.

    Attributes:
        sections: they go through.
        passes: how many times they have.
    """

    def __init__(
        self, predictor: Predictor, structure: Structure, sections: Sequence[Section], threads: int | None
    ) -> None:
        """Filters for a compiled predictor and its structure."""
        self.sections = tuple(sections)
        self._predictor, self._structure, self._threads = predictor, structure, threads
        self.passes = 0

    def vector(self, experiment: Experiment, levels: Levels) -> Floats:
        """The numbers that filters take, of an experiment."""
        values = leaves(experiment) | {f"time.{name}": levels.scatter[name].time for name in NAMES}
        return np.array([float(values[name]) for name in parameter_names(self._structure)])

    def weigh(
        self,
        experiment: Experiment,
        levels: Levels,
        *,
        outlier: float = np.inf,
        gains: bool = True,
        rows: bool = False,
        samples: int | None = None,
        watched: int = 0,
        into: Sequence[FilterPass] = (),
    ) -> list[FilterPass]:
        """Gains in every section; arguments as of `codegen.drivers.prediction.Predictor.filter`, `into` of each.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        old = dict(zip(map(id, self.sections), into, strict=False))

        def weigh(section: Section) -> FilterPass:
            part, before = section.upto(samples) if samples else section, old.get(id(section))
            return self._weighed(
                experiment, levels, part, outlier=outlier, gains=gains, rows=rows, watched=watched, into=before
            )

        return self._each(weigh)

    def _weighed(self, experiment: Experiment, levels: Levels, section: Section, **how: Any) -> FilterPass:
        """Gains in a section; `how` as of `codegen.drivers.prediction.Predictor.filter`."""
        course, covariance = self.course(experiment, levels, section)
        spread = FilterCovariances(covariance, self.walk(experiment, levels), levels.noise)
        return self._predictor.filter(self.vector(experiment, levels), course, spread, **how)

    def unlikely(self, experiments: Sequence[Experiment], levels: Levels, *, outlier: float) -> Floats:
        """How unlikely all sections are for each of some machines: minus twice the logarithm, but for a constant.

        Infinite where a filter goes astray.

        Raises:
            KeyboardInterrupt: interrupted.
        """

        def unlikely(experiment: Experiment, section: Section) -> float:
            weights = self._weighed(experiment, levels, section, outlier=outlier, gains=False)
            return 2 * weights.negative_log_likelihood if all_completed([weights]) else np.inf

        jobs = [lambda pair=pair: unlikely(*pair) for pair in product(experiments, self.sections)]
        self.passes += len(experiments)
        return np.array(self._all(jobs)).reshape(len(experiments), -1).sum(axis=1)

    def predict(
        self,
        vector: Floats,
        experiment: Experiment,
        levels: Levels,
        weights: Sequence[FilterPass],
        *,
        rows: bool = False,
    ) -> list[FixedGainPrediction]:
        """What is expected in every section with given gains, of machines with the numbers of a vector.

        Args:
            vector: of `vector`, in part replaced.
            experiment: gives the start.
            levels: likewise.
            weights: of the sections.
            rows: whether surprises are kept.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        numbered = dict(zip(map(id, self.sections), weights, strict=True))

        def predict(section: Section) -> FixedGainPrediction:
            course, _ = self.course(experiment, levels, section)
            return self._predictor.predict(vector, course, numbered[id(section)], rows=rows)

        return self._each(predict)

    def smooth(self, experiment: Experiment, levels: Levels) -> list[tuple[Floats, Floats, Floats]]:
        """What acted unrecorded in every section, by all its readings.

        Returns:
            Of each section (samples, states) what was expected at the time, (samples, unrecorded) what acted, and
            (samples, unrecorded, unrecorded) the covariances of that.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        weights = self.weigh(experiment, levels, rows=True, watched=len(NAMES))
        numbered = dict(zip(map(id, self.sections), weights, strict=True))
        vector = self.vector(experiment, levels)

        def smooth(section: Section) -> tuple[Floats, Floats, Floats]:
            course, own = self.course(experiment, levels, section)[0], numbered[id(section)]
            return np.asarray(own.states), *self._predictor.smooth(vector, course, own)

        return self._each(smooth)

    def _each(self, work: Callable[[Section], object]) -> list:
        self.passes += 1
        return self._all([lambda section=section: work(section) for section in self.sections])

    def _all(self, jobs: Sequence[Callable[[], object]]) -> list:
        found: list[object] = [None] * len(jobs)

        def do(index: int) -> None:
            found[index] = jobs[index]()

        if not run_all([lambda index=index: do(index) for index in range(len(found))], self._threads):
            raise KeyboardInterrupt
        return found

    def course(self, experiment: Experiment, levels: Levels, section: Section) -> tuple[FilterData, Floats]:
        """A section as its filter takes it, and the covariance of what is expected at its start."""
        first = np.full(section.readings.shape[1], np.nan)
        for column in range(len(first)):
            early = section.readings[:LOOK, column]
            known = early[np.isfinite(early)]
            first[column] = known[0] if len(known) else np.nan
        torques = float(section.torques[0, 0]), float(section.torques[0, 1])
        start, covariance = starting(
            experiment, self._structure, first, torques, float(section.inputs[0, 0]), levels.scatter
        )
        return FilterData(section.inputs, section.readings, start), covariance

    def walk(self, experiment: Experiment, levels: Levels) -> Floats:
        """What a sample adds to the states' variances, (states,)."""
        template: MachineState = state_template(self._structure)
        step, walk = experiment.simulation.sample_time, dict.fromkeys(leaves(template), 0.0)
        for name, each in levels.scatter.items():
            walk[f"unrecorded.{name}"] = each.deviation**2 * -np.expm1(-2 * step / each.time)
        return np.array(list(walk.values()))


def all_completed(runs: Sequence[FilterPass | FixedGainPrediction]) -> bool:
    """Whether no filter left the track or went astray."""
    return all(run.outcome == Outcome.COMPLETED for run in runs)
