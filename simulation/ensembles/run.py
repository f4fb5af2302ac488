"""Run ensembles: portion after portion, on all cores and in all lanes; memory does not grow with their number."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import BatchResult, in_portions, portion_size, rollout
from dualwinch.simulation.batch.workers import Workers, threads_of
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import no_progress, part
from dualwinch.simulation.results.outcomes import WORDS, RunOutcomes, concatenated
from dualwinch.simulation.scenario import Scenario, Value

TRACED = ("e", "F1", "F2")
"""Columns whose traces are kept."""

SAMPLED = 2000
"""Scenarios whose traces are kept one by one (12 MB); of all others only their extremes."""

POINTS = 500
"""Instants of a trace."""

LARGEST = 1e30
"""Magnitude a trace is limited to, within the range of single precision."""


def run_ensemble(
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    traces: bool = True,
    workers: Workers = None,
    progress: Callable[[float], None] = no_progress,
) -> EnsembleResult:
    """Run scenarios of an ensemble.

    An interrupt (Ctrl-C) ends the run and keeps the scenarios that were finished, as a result that says so.

    Args:
        ensemble: of the scenarios.
        scenarios: how many.
        seed: of the draws; the same seed gives the same scenarios, bit for bit, however many there are.
        traces: whether traces are kept, for figures.
        workers: threads of this machine (default: one a core), or an executor.
        progress: receives the fraction of the scenarios that are done.

    Raises:
        ConfigurationError: a count or seed out of range, or values that do not fit together.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: before the first scenario was finished.
    """
    (result,) = run_side_by_side([ensemble], scenarios, seed, POINTS if traces else 0, workers, progress)
    return result


def run_side_by_side(
    ensembles: Sequence[Ensemble],
    scenarios: int,
    seed: int,
    points: int = 0,
    workers: Workers = None,
    progress: Callable[[float], None] = no_progress,
) -> list[EnsembleResult]:
    """Run the same scenarios of several ensembles, which differ in their controllers alone; as `run_ensemble`.

    Scenarios are drawn and run a portion at a time, each portion by every ensemble. An interrupt keeps the scenarios
    that all ensembles have finished.

    Args:
        ensembles: one or more.
        scenarios: how many.
        seed: of the draws.
        points: instants of the traces, at most; 0 keeps none.
        workers: of this machine, or an executor; default: one thread a core.
        progress: receives the fraction that is done.
    """
    if scenarios < 1:
        raise ConfigurationError(f"scenarios = {scenarios}: must be a whole number >= 1")
    if seed < 0:
        raise ConfigurationError(f"seed = {seed}: must be a whole number >= 0")
    for ensemble in ensembles:
        prepare(ensemble.experiment)
    size, threads = portion_size(ensembles[0].experiment, threads_of(workers))
    stride = -(-ensembles[0].experiment.samples // points) if points else 0
    portions: list[tuple[list[RunOutcomes], list[tuple[Value, ...]]]] = []
    traces: list[Traces | None] = [None] * len(ensembles)
    try:
        for portion in zip(*(in_portions(each.scenarios(scenarios, seed), size) for each in ensembles), strict=True):
            report = part(progress, portion[0][0].index / scenarios, (portion[0][-1].index + 1) / scenarios)
            ran = _run_portion(portion, stride, threads, report)
            finished = min(map(_finished, ran)) if len(ran) == len(portion) else 0
            if finished:
                values = [tuple(scenario.draws.values()) for scenario in portion[0][:finished]]
                portions.append(([_taken(run, finished) for run in ran], values))
                traces = [_traced(before, run, finished) for before, run in zip(traces, ran, strict=True)]
            if ran[-1].interrupted:
                break
    except KeyboardInterrupt:
        if not portions:
            raise
    if not portions:
        raise KeyboardInterrupt
    draws = zip(*(values for _, drawn in portions for values in drawn), strict=True)
    columns = dict(zip(ensembles[0].drawn_keys, map(np.array, draws), strict=True))
    runs = [concatenated(of_one) for of_one in zip(*(runs for runs, _ in portions), strict=True)]
    return [
        EnsembleResult(run.outcomes, run.end_times, run.metrics, ensemble, seed, scenarios, columns, traced)
        for ensemble, run, traced in zip(ensembles, runs, traces, strict=True)
    ]


def _run_portion(
    portion: Sequence[list[Scenario]], stride: int, threads: int, progress: Callable[[float], None]
) -> list[BatchResult]:
    """A portion of the scenarios by every ensemble, up to the first run that is interrupted."""
    ran: list[BatchResult] = []
    for number, chosen in enumerate(portion):
        report = part(progress, number / len(portion), (number + 1) / len(portion))
        ran.append(rollout([], np.empty((1, 0)), chosen, stride=stride, workers=threads, progress=report))
        if ran[-1].interrupted:
            break
    return ran


def _finished(run: BatchResult) -> int:
    """Number of a portion's scenarios before the first that an interrupt left out."""
    left_out = run.outcomes[0] == WORDS[Outcome.NOT_RUN]
    return int(left_out.argmax()) if left_out.any() else len(left_out)


def _taken(run: BatchResult, finished: int) -> RunOutcomes:
    """The outcomes of a portion's finished scenarios, without their traces."""
    return RunOutcomes(run.outcomes, run.end_times, run.metrics).take(0, axis=0).take(range(finished))


def _traced(before: Traces | None, run: BatchResult, finished: int) -> Traces | None:
    """The traces so far with those of a portion's finished scenarios that were completed."""
    completed = np.flatnonzero(run.completed[0, :finished])
    if not (run.columns and completed.size):
        return before
    signals: dict[str, NDArray[np.float32]] = {
        name: run.columns[name][0, completed].clip(-LARGEST, LARGEST).astype(np.float32) for name in TRACED
    }
    if before is None:
        ends = {name: values[0] for name, values in signals.items()}
        none = {name: values[:0] for name, values in signals.items()}
        before = Traces(run.columns["t"][0, completed[0]], none, ends, ends)
    room = SAMPLED - len(before.sampled[TRACED[0]])
    return Traces(
        before.t,
        {name: np.concatenate([before.sampled[name], values[:room]]) for name, values in signals.items()},
        {name: np.minimum(before.lowest[name], values.min(axis=0)) for name, values in signals.items()},
        {name: np.maximum(before.highest[name], values.max(axis=0)) for name, values in signals.items()},
    )
