"""Run an ensemble: portion after portion, on all cores and in all lanes; memory does not grow with their number."""

from array import array
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice
from sys import intern

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import BatchResult, in_portions, portion_size, rollout
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import no_progress
from dualwinch.simulation.results.outcomes import WORDS
from dualwinch.simulation.scenario import Scenario

TRACED = ("e", "F1", "F2")
"""Columns whose traces are kept."""

SAMPLED = 2000
"""Scenarios whose traces are kept one by one (12 MB); of all others only their extremes."""


@dataclass(frozen=True)
class Finished:
    """One scenario after its run.

    Attributes:
        scenario: what was run.
        metrics: figure of merit → value.
        outcome, end_time: how it ended, and when in s.
        t: (rows,) times in s of the trace.
        trace: (columns of `TRACED`, rows) float32.
    """

    scenario: Scenario
    metrics: dict[str, float]
    outcome: str
    end_time: float
    t: NDArray[np.float64]
    trace: NDArray[np.float32]


class Collector:
    """Finished scenarios of an ensemble so far."""

    def __init__(self, ensemble: Ensemble) -> None:
        self.ensemble = ensemble
        self._draws: list[tuple] = []
        self._outcomes: list[str] = []
        self._end_times, self._metrics = array("d"), array("d")
        self._merits: tuple[str, ...] = ()
        self._count = 0
        self._t = np.empty(0)
        self._sampled: list[NDArray[np.float32]] = []
        self._lowest = self._highest = np.empty(0, np.float32)

    def __len__(self) -> int:
        return self._count

    def add(self, run: Finished) -> None:
        """Take a scenario in."""
        if run.outcome == "completed" and run.t.size:
            if not self._sampled:
                self._t, self._lowest, self._highest = run.t, run.trace, run.trace
            if len(self._sampled) < SAMPLED:
                self._sampled.append(run.trace)
            self._lowest = np.minimum(self._lowest, run.trace)
            self._highest = np.maximum(self._highest, run.trace)
        self._draws.append(tuple(run.scenario.draws.values()))
        self._outcomes.append(intern(run.outcome))
        self._end_times.append(run.end_time)
        self._merits = tuple(run.metrics)
        self._metrics.extend(run.metrics.values())
        self._count += 1

    def result(self, seed: int, asked: int) -> EnsembleResult:
        """The result of the scenarios taken in; of an interrupted `add` nothing is seen.

        Args:
            seed: of the draws.
            asked: number of scenarios asked for.
        """
        count = len(self)
        merits = np.array(self._metrics[: count * len(self._merits)]).reshape(count, -1).T
        draws = zip(*self._draws[:count], strict=True)
        return EnsembleResult(
            ensemble=self.ensemble,
            seed=seed,
            asked=asked,
            draws={key: np.array(values) for key, values in zip(self.ensemble.drawn_keys, draws, strict=True)},
            outcomes=np.array(self._outcomes[:count], dtype=np.str_),
            end_times=np.array(self._end_times[:count]),
            metrics=dict(zip(self._merits, merits, strict=True)),
            traces=self._traces() if self._sampled else None,
        )

    def _traces(self) -> Traces:
        sampled = np.array(self._sampled)
        return Traces(
            t=self._t,
            sampled={column: sampled[:, index] for index, column in enumerate(TRACED)},
            lowest={column: self._lowest[index] for index, column in enumerate(TRACED)},
            highest={column: self._highest[index] for index, column in enumerate(TRACED)},
        )


POINTS = 500
"""Instants of a trace."""

LARGEST = 1e30
"""Magnitude a trace is limited to, within the range of single precision."""


def rollout_scenarios(
    scenarios: Iterable[Scenario], points: int = 0, workers: int | None = None
) -> Generator[Finished, None, None]:
    """Run scenarios of one structure and length portion by portion, and give them back in their order.

    Args:
        scenarios: drawn a portion at a time.
        points: instants of the traces, at most; 0 keeps none.
        workers: threads (default: one a core); the compiled code runs without Python's lock.

    Raises:
        ConfigurationError: the values of a scenario do not fit together; the message names its number.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: after all that was finished by then has been given back.
    """
    stream = iter(scenarios)
    for first in islice(stream, 1):
        size, threads = portion_size(first.base, workers)
        stride = -(-first.base.samples // points) if points else 0
        for portion in in_portions(chain((first,), stream), size):
            result = rollout([], np.empty((1, 0)), portion, stride=stride, threads=threads)
            yield from _finished(portion, result)
            if result.interrupted:
                raise KeyboardInterrupt


def _finished(portion: list[Scenario], result: BatchResult) -> Iterator[Finished]:
    """The scenarios of a portion up to the first that an interrupt left out."""
    outcomes, end_times = result.outcomes[0].tolist(), result.end_times[0].tolist()
    rows = np.array(list(result.metrics.values()))[:, 0].T.tolist()
    t, traces = np.empty((len(portion), 0)), np.empty((len(portion), 0, 0), np.float32)
    if result.columns:
        traced = np.array([result.columns[name][0] for name in TRACED])
        t, traces = result.columns["t"][0], traced.clip(-LARGEST, LARGEST).astype(np.float32).swapaxes(0, 1)
    for index, scenario in enumerate(portion):
        if outcomes[index] == WORDS[Outcome.NOT_RUN]:
            return
        metrics = dict(zip(result.metrics, rows[index], strict=True))
        yield Finished(scenario, metrics, outcomes[index], end_times[index], t[index], traces[index])


def run_ensemble(
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    traces: bool = True,
    workers: int | None = None,
    progress: Callable[[float], None] = no_progress,
) -> EnsembleResult:
    """Run scenarios of an ensemble.

    An interrupt (Ctrl-C) ends the run and keeps the scenarios that were finished, as a result that says so.

    Args:
        ensemble: what the scenarios are drawn from.
        scenarios: how many.
        seed: of the draws; the same seed gives the same scenarios, bit for bit, however many there are.
        traces: whether traces are kept, for figures.
        workers: threads (default: one a core).
        progress: receives the fraction of the scenarios that are done.

    Raises:
        ConfigurationError: a count or seed out of range, or values that do not fit together.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: before the first scenario was finished.
    """
    if scenarios < 1:
        raise ConfigurationError(f"scenarios = {scenarios}: must be a whole number >= 1")
    if seed < 0:
        raise ConfigurationError(f"seed = {seed}: must be a whole number >= 0")
    prepare(ensemble.experiment)
    kept = Collector(ensemble)
    finished = rollout_scenarios(ensemble.scenarios(scenarios, seed), POINTS if traces else 0, workers)
    try:
        for run in finished:
            kept.add(run)
            progress(len(kept) / scenarios)
    except KeyboardInterrupt:
        if not len(kept):
            raise
    finally:
        finished.close()
    return kept.result(seed, scenarios)
