"""Run an ensemble: portion after portion, on all cores and in all lanes; memory does not grow with their number."""

from collections.abc import Callable, Generator, Iterable, Iterator
from itertools import chain, islice

import numpy as np

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.portions import in_portions, portion_size
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.collector import TRACED, Collector, Finished
from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.results.outcomes import WORDS

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
    progress: Callable[[int], None] | None = None,
) -> EnsembleResult:
    """Run scenarios of an ensemble.

    An interrupt (Ctrl-C) ends the run and keeps the scenarios that were finished, as a result that says so.

    Args:
        ensemble: what the scenarios are drawn from.
        scenarios: how many.
        seed: of the draws; the same seed gives the same scenarios, bit for bit, however many there are.
        traces: whether traces are kept, for figures.
        workers: threads (default: one a core).
        progress: called after each scenario with the number that are done; they come in portions.

    Raises:
        ConfigurationError: a count or seed out of range, or values that do not fit together.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: before the first scenario was finished.
    """
    if scenarios < 1:
        raise ConfigurationError(f"scenarios = {scenarios}: must be a whole number >= 1")
    if seed < 0:
        raise ConfigurationError(f"seed = {seed}: must be a whole number >= 0")
    check(ensemble.experiment)
    kept = Collector(ensemble)
    finished = rollout_scenarios(ensemble.scenarios(scenarios, seed), POINTS if traces else 0, workers)
    try:
        for run in finished:
            kept.add(run)
            if progress:
                progress(len(kept))
    except KeyboardInterrupt:
        if not len(kept):
            raise
    finally:
        finished.close()
    return kept.result(seed, scenarios)
