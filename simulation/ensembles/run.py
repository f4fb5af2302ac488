"""Run ensembles in portions, on all cores and in vector lanes, with bounded memory."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.model.arguments import instance, whole_number
from dualwinch.simulation.batch.rollout import BatchResult, portion_size, rollout
from dualwinch.simulation.batch.workers import Workers, in_order, portion_of, spread, threads_of
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces
from dualwinch.simulation.plots.traces import PIXEL_COLUMNS
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.progress import Progress, no_progress, part
from dualwinch.simulation.results.outcomes import WORDS, RunOutcomes, concatenated
from dualwinch.simulation.scenario import Value

TRACED = ("e", "F1", "F2")
"""Columns whose traces are kept."""

SAMPLED = 2000
"""Number of first scenarios whose traces are kept individually (22 MB); for all others, only the extremes are."""


def run_ensemble(
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    traces: bool = True,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> EnsembleResult:
    """Run scenarios of an ensemble.

    An interrupt (Ctrl-C) ends the run; the result then covers the finished scenarios and is marked as `partial`.

    Args:
        ensemble: ensemble of the scenarios.
        scenarios: number of scenarios.
        seed: seed of the draws; the same seed gives the same scenarios, bit for bit, for any number of them.
        traces: whether to keep traces, for figures.
        workers: number of threads on this machine (default: one per core), or an executor.
        progress: called with the fraction of finished scenarios.

    Raises:
        ConfigurationError: a count or seed out of range, or inconsistent values.
        DualwinchError: no compiler or no usable cache folder.
        KeyboardInterrupt: before the first scenario was finished.

    Example:
        >>> import dualwinch as dw
        >>> sea = dw.load_ensemble("sea", dw.override(dw.Experiment(), {"simulation.duration": 2.0}))
        >>> result = dw.run_ensemble(sea, scenarios=8, seed=0)
        >>> result.completed.sum()
        np.int64(8)
    """
    (result,) = run_side_by_side([ensemble], scenarios, seed, PIXEL_COLUMNS if traces else 0, workers, progress)
    return result


def run_side_by_side(
    ensembles: Sequence[Ensemble],
    scenarios: int,
    seed: int,
    points: int = 0,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> list[EnsembleResult]:
    """Run the same scenarios of several ensembles that differ only in their controllers; see `run_ensemble`.

    Scenarios are drawn and run in portions, each portion by every ensemble. After an interrupt, results cover the
    scenarios that all ensembles have finished. Traces have at most `points` instants; 0 keeps none.
    """
    portions = list[EnsemblePortion]()
    traces: list[Traces | None] = [None] * len(ensembles)
    try:
        for portion in portions_of(ensembles, scenarios, seed, points, workers, progress, whole):
            portions.append(replace(portion, traces=()))
            traces = [_merged(before, addition) for before, addition in zip(traces, portion.traces, strict=True)]
    except KeyboardInterrupt:
        if not portions:
            raise
    if not portions:
        raise KeyboardInterrupt
    draws = zip(*(values for portion in portions for values in portion.draws), strict=True)
    columns = dict(zip(ensembles[0].drawn_keys, map(np.array, draws), strict=True))
    runs = [concatenated(of_one) for of_one in zip(*(portion.runs for portion in portions), strict=True)]
    return [
        EnsembleResult(run.outcomes, run.end_times, run.metrics, ensemble, seed, scenarios, columns, traced)
        for ensemble, run, traced in zip(ensembles, runs, traces, strict=True)
    ]


@dataclass(frozen=True)
class EnsemblePortion:
    """Successive scenarios, run by every ensemble: draws of each scenario, outcomes and traces of each ensemble.

    Traces are None where none were kept, or no run completed.
    """

    draws: list[tuple[Value, ...]]
    runs: list[RunOutcomes]
    traces: Sequence[Traces | None]


Reduced = TypeVar("Reduced")


def whole(portion: EnsemblePortion) -> EnsemblePortion:
    """A portion as it is."""
    return portion


def portions_of(
    ensembles: Sequence[Ensemble],
    scenarios: int,
    seed: int,
    points: int,
    workers: Workers,
    progress: Progress,
    reduced: Callable[[EnsemblePortion], Reduced],
) -> Iterator[Reduced]:
    """Portions of the scenarios of `run_side_by_side`, in order, each reduced where it was run.

    After an interrupt, threads end with a shorter portion; workers raise `KeyboardInterrupt`.

    Raises:
        ConfigurationError: a count or seed out of range, or inconsistent values.
        DualwinchError: no compiler or no usable cache folder.
    """
    check_counts(ensembles, scenarios, seed)
    size, threads = portion_size(ensembles[0].experiment, threads_of(workers))
    if isinstance(workers, Executor):
        size = portion_of(scenarios)
    stride = -(-ensembles[0].experiment.samples // points) if points else 0
    portions = [range(start, min(start + size, scenarios)) for start in range(0, scenarios, size)]
    if isinstance(workers, Executor):
        tasks = ((ensembles, indices, seed, stride, reduced) for indices in portions)
        for indices, portion in zip(portions, in_order(spread(workers, ensemble_portion, tasks)), strict=True):
            yield portion
            progress(indices.stop / scenarios)
        return
    for indices in portions:
        runs = _run_portion(
            ensembles,
            indices,
            seed,
            stride,
            threads,
            part(progress, indices.start / scenarios, indices.stop / scenarios),
        )
        finished = min(map(_finished, runs)) if len(runs) == len(ensembles) else 0
        if finished:
            yield reduced(_portion(ensembles[0], indices[:finished], seed, runs))
        if runs[-1].interrupted:
            return


def check_counts(ensembles: Sequence[Ensemble], scenarios: int, seed: int) -> None:
    """Raise `ConfigurationError` if a count or seed is out of range, or values are inconsistent."""
    whole_number("scenarios", scenarios, 1)
    whole_number("seed", seed)
    for ensemble in ensembles:
        instance("ensemble", ensemble, Ensemble, hint=" (load_ensemble reads one)")
        prepare(ensemble.experiment)


def ensemble_portion(
    ensembles: Sequence[Ensemble],
    indices: range,
    seed: int,
    stride: int,
    reduced: Callable[[EnsemblePortion], Reduced],
) -> Reduced:
    """Draw scenarios by index and run them with every ensemble, on one thread of a worker."""
    return reduced(
        _portion(ensembles[0], indices, seed, _run_portion(ensembles, indices, seed, stride, 1, no_progress))
    )


def _portion(ensemble: Ensemble, indices: range, seed: int, runs: Sequence[BatchResult]) -> EnsemblePortion:
    """Results of the first scenarios that every ensemble has finished, with only the outcomes and traces to keep."""
    count, sampled = len(indices), max(0, SAMPLED - indices.start)
    return EnsemblePortion(
        draws=[tuple(scenario.draws.values()) for scenario in ensemble.chosen(indices, seed)],
        runs=[RunOutcomes(run.outcomes, run.end_times, run.metrics).take(0, axis=0).take(range(count)) for run in runs],
        traces=[_traces(run, count, sampled) for run in runs],
    )


def _run_portion(
    ensembles: Sequence[Ensemble], indices: range, seed: int, stride: int, threads: int, progress: Progress
) -> list[BatchResult]:
    """Run a portion with every ensemble, up to the first interrupted run."""
    runs: list[BatchResult] = []
    for number, ensemble in enumerate(ensembles):
        report = part(progress, number / len(ensembles), (number + 1) / len(ensembles))
        scenarios = ensemble.chosen(indices, seed)
        runs.append(rollout([], np.empty((1, 0)), scenarios, stride=stride, workers=threads, progress=report))
        if runs[-1].interrupted:
            break
    return runs


def _finished(run: BatchResult) -> int:
    """Number of a portion's scenarios before the first that was not run because of an interrupt."""
    return int((run.outcomes[0] != WORDS[Outcome.NOT_RUN]).cumprod().sum())


def _traces(run: BatchResult, finished: int, sampled: int) -> Traces | None:
    """Traces of a portion's completed scenarios, individually for the first `sampled`."""
    completed = np.flatnonzero(run.completed[0, :finished])
    if not (run.columns and completed.size):
        return None
    largest = float(np.finfo(np.float32).max)
    signals: dict[str, NDArray[np.float32]] = {
        name: run.columns[name][0, completed].clip(-largest, largest).astype(np.float32) for name in TRACED
    }
    return Traces(
        run.columns["t"][0, completed[0]],
        {name: values[completed < sampled] for name, values in signals.items()},
        {name: values.min(axis=0) for name, values in signals.items()},
        {name: values.max(axis=0) for name, values in signals.items()},
    )


def _merged(before: Traces | None, more: Traces | None) -> Traces | None:
    """Merge the traces so far with those of the next portion."""
    if before is None or more is None:
        return before or more
    return Traces(
        before.t,
        {name: np.concatenate([values, more.sampled[name]]) for name, values in before.sampled.items()},
        {name: np.minimum(values, more.lowest[name]) for name, values in before.lowest.items()},
        {name: np.maximum(values, more.highest[name]) for name, values in before.highest.items()},
    )
