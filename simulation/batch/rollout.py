"""Many rollouts in one call: every set of parameters in every scenario, in vector lanes and on all cores."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.batch import LANES, compile_batch
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.signals.signals import Signals
from dualwinch.codegen.drivers.unit import kept_rows
from dualwinch.model.arguments import texts, whole_number
from dualwinch.model.disturbance import given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.scenarios import Scenarios, by_structure, check_batch, experiment_of
from dualwinch.simulation.batch.workers import Workers, cores, portion_of, run_all, spread, threads_of
from dualwinch.simulation.exogenous.signals import exogenous_signals, exogenous_sources
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import absent_signals, closed_loop, exogenous_names, starts
from dualwinch.simulation.loop.engine import Engine, engine_of
from dualwinch.simulation.loop.structure import structure_of, zeros_of
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import final_states, metric_quantities, metrics_of
from dualwinch.simulation.prepare import memory_room
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.outcomes import RunOutcomes, not_run, words_of
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]


class ParameterScenarioGrid:
    """All pairs of n sets of parameters and m scenarios.

    Attributes:
        names: keys of the varied parameters.
        values: (n, names).
        shared: an experiment with their common length, sample time, engine and metrics.
        structure, loop: their common closed loop.
        zeros: parameters and signals that are zero in all scenarios and not varied; the loop leaves them out.
        indices: (pairs, 2) set and scenario of all pairs, grouped by scenario.
    """

    def __init__(
        self,
        names: Sequence[str],
        parameters: ArrayLike,
        scenarios: Scenarios,
        zeros: frozenset[str] | None = None,
    ) -> None:
        """Set up the grid and check that its values are consistent.

        Args:
            names: keys of the varied parameters.
            parameters: (n, names).
            scenarios: the m scenarios.
            zeros: zeros of a larger grid that contains this one, so that both run the same compiled code; default:
                those of this grid.

        Raises:
            ConfigurationError: an unknown name, a wrong shape, a value out of range, or incompatible scenarios.
        """
        self.names, self.values = tuple(names), np.asarray(parameters, float)
        self._scenarios = scenarios
        self._groups = groups = check_batch(self.names, self.values, scenarios)
        self.shared = groups[0].experiment
        drawn_keys = frozenset[str]().union(*(group.drawn_keys for group in groups))
        nonzero = {key for group in groups for key, column in group.columns.items() if column.any()}
        self.structure = structure_of(self.shared)
        if zeros is None:
            zeros = zeros_of(self.structure, *(group.numbers for group in groups), varying=[*names, *drawn_keys])
            zeros |= absent_signals(*(group.experiment for group in groups), varying=nonzero)
        self.zeros = zeros
        self.loop = closed_loop(self.structure, self.zeros)
        self.columns = [self.loop.parameters.index(name) for name in names]
        self.indices = np.array([(i, j) for j in range(len(scenarios)) for i in range(len(self.values))])
        self._vectors = np.empty((len(scenarios), len(self.loop.parameters)))
        self.beginnings = np.empty(len(scenarios))  # in m
        self._at = np.empty((len(scenarios), 2), np.int64)  # group, and index in it
        for number, group in enumerate(groups):
            self.loop.vector(group.numbers)
            self._vectors[group.members], self.beginnings[group.members] = (
                group.vectors,
                group.experiment.reference.start,
            )
            self._at[group.members] = np.stack(np.broadcast_arrays(number, np.arange(len(group.members))), axis=1)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, m)."""
        return len(self.values), len(self._scenarios)

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The users' metrics; their parameters, where not the same in all pairs, broadcast to (n, m)."""
        numbers: dict[str, float | Floats] = {}
        for index, name in enumerate(self.loop.parameters):
            if not name.startswith("metrics."):
                continue
            values = self._vectors[:, index]
            numbers[name] = float(values[0]) if (values == values[0]).all() else values[np.newaxis]
            if name in self.names:
                numbers[name] = self.values[:, [self.names.index(name)]]
        return tuple(with_leaves(metric, numbers, "metrics.") for metric in self.shared.metrics)

    def portions(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Split into parts that are worth sending: indices of sets and of scenarios, whose pairs are one part."""
        sets, scenarios = self.shape
        size = portion_of(sets * scenarios)
        together = max(1, size // sets)
        for scene in range(0, scenarios, together):
            for start in range(0, sets, size):
                yield np.arange(start, min(start + size, sets)), np.arange(scene, min(scene + together, scenarios))

    def part(
        self, sets: NDArray[np.int64], scenarios: NDArray[np.int64]
    ) -> tuple[tuple[str, ...], Floats, Scenarios, frozenset[str]]:
        """The arguments of a grid of some of the sets and scenarios."""
        return self.names, self.values[sets], [self._scenarios[j] for j in scenarios.tolist()], self.zeros

    def vectors(self, indices: NDArray[np.int64]) -> Floats:
        """Parameter vectors of some pairs, (pairs, parameters)."""
        sets, scenarios = indices.T
        vectors = self._vectors[scenarios]
        vectors[:, self.columns] = self.values[sets]
        return vectors

    def starts(self, vectors: Floats, scenarios: ArrayLike) -> Floats:
        """Initial states (pairs, states) for parameter vectors (pairs, parameters) in scenarios (pairs,)."""
        return starts(self.structure, vectors, self.beginnings[np.asarray(scenarios)])

    def sources(self, scenarios: Iterable[int]) -> list[Signals]:
        """Exogenous signals of some scenarios, drawn while these run; one object per scenario."""
        numbers = np.array(list(scenarios))
        sources_by_member: dict[int, Signals] = {}
        for number in set(self._at[numbers, 0].tolist()):
            group = self._groups[number]
            members = np.unique(self._at[numbers[self._at[numbers, 0] == number], 1])
            columns = {key: column[members] for key, column in group.columns.items()}
            sources = exogenous_sources(group.experiment, columns, len(members))
            sources_by_member |= zip(group.members[members].tolist(), sources, strict=True)
        return [sources_by_member[j] for j in numbers.tolist()]

    def experiment(self, j: int) -> Experiment:
        """The experiment of a scenario."""
        return experiment_of(self._scenarios[j])

    def signals(self, j: int) -> Floats:
        """Exogenous signals of a scenario, drawn ahead, (samples, exogenous)."""
        return exogenous_signals(self.experiment(j))


@dataclass(frozen=True, eq=False)
class BatchResult(RunOutcomes):
    """Results of a batch, for every set of parameters (n) in every scenario (m).

    Attributes:
        outcomes: (n, m) words: ``completed``, ``diverged``, ``left_track``, with `max_slack` also ``went_slack``, and
            after an interrupt ``not_run``.
        end_times: (n, m) in s.
        metrics: name → (n, m), as in `Metrics` and of the users' own; NaN where a pair was not completed.
        columns: name → (n, m, kept) if rows are kept, NaN after an early end; else empty.
        interrupted: whether an interrupt ended the batch, even if every pair was already running and is finished.
    """

    columns: dict[str, Floats]
    interrupted: bool = False

    @property
    def _arrays(self) -> Mapping[str, NDArray[Any] | Mapping[str, NDArray[Any]]]:
        return {**super()._arrays, "columns": self.columns}


def rollout(
    names: Sequence[str],
    parameters: ArrayLike,
    scenarios: Sequence[Experiment | Scenario],
    *,
    stride: int = 0,
    max_slack: float | None = None,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> BatchResult:
    """Run every set of parameters in every scenario.

    The result of a pair depends only on the pair, not on its lane or the number of pairs or threads. It equals that of
    `simulate` up to the elementary functions, whose relative error here is up to 1e-9. Scenarios of another engine than
    ``compiled`` (``simulation.engine``) run one by one, as in `simulate`.

    Args:
        names: keys of the varied parameters, e.g. ``["controller.nftsm.beta", "controller.observer.l0"]``. Varying
            ``plant.*`` does not change the controller's nominal plant (``nominal.*``).
        parameters: (n, len(names)), a value for each name.
        scenarios: m experiments, or draws of an ensemble (whose controller has the undrawn plant as nominal plant), of
            one structure and length; source of all other values.
        stride: keep every `stride`-th sample as a row; 0 keeps none.
        max_slack: end a run once a rope has been slack for more than this share of all its samples; default: never.
            Sub-steps through slack take several times as long, and delay the runs in the neighbouring lanes.
        workers: number of workers on this machine, or an executor; default: one thread per core.
        progress: called from time to time with the completed fraction.

    Returns:
        The result; after an interrupt (Ctrl-C), unfinished pairs have the outcome ``not_run``.

    Raises:
        ConfigurationError: an unknown name, a wrong shape, a value out of range, or incompatible scenarios.
        DualwinchError: no compiler or no usable cache folder.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 1.0})
        >>> outcomes = dw.rollout(["controller.nftsm.beta"], [[0.5], [1.0]], [run])
        >>> outcomes.metrics["mse"].shape
        (2, 1)
    """
    if max_slack is not None and not 0 <= max_slack <= 1:
        raise ConfigurationError(f"max_slack = {max_slack:g}: must be a share, 0 to 1")
    whole_number("stride", stride)
    if isinstance(scenarios, Experiment | Scenario):
        raise ConfigurationError(f"scenarios: must be a list, not one {type(scenarios).__name__}")
    names = texts("names", names)
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"names: '{name}' is given {names.count(name)} times")
    try:
        parameters = np.asarray(parameters, np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"parameters: must be an array of numbers ({error})") from error
    return _batch(names, parameters, scenarios, stride, max_slack, workers, progress, alike=True)


def run_grid(
    experiments: NDArray[np.object_],
    *,
    workers: Workers = None,
    progress: Progress = no_progress,
) -> BatchResult:
    """Run an array of experiments, in vector lanes where they have the same structure, length and sample time.

    Args:
        experiments: array of `Experiment` or `Scenario`, of any shape.
        workers: number of workers on this machine, or an executor; default: one thread per core.
        progress: called from time to time with the completed fraction.

    Returns:
        Results of the same shape; after an interrupt (Ctrl-C), unfinished runs have the outcome ``not_run``.

    Raises:
        ConfigurationError: the values of an experiment are inconsistent.
        DualwinchError: no compiler or no usable cache folder.
    """
    flat_experiments = experiments.ravel().tolist()
    result = _batch([], np.empty((1, 0)), flat_experiments, 0, None, workers, progress, alike=False)
    return result.take(0, axis=0).reshape(experiments.shape)


def _batch(
    names: Sequence[str],
    parameters: ArrayLike,
    scenarios: Scenarios,
    stride: int,
    max_slack: float | None,
    workers: Workers,
    progress: Progress,
    *,
    alike: bool,
) -> BatchResult:
    """`rollout`, structure by structure; `alike`: structures may differ only in their sub-steps."""
    parts = [
        (ParameterScenarioGrid(names, parameters, together), places, report)
        for places, together, report in by_structure(scenarios, progress, alike=alike)
    ]
    result = _empty_result(parts[0][0], len(scenarios), stride)

    def run_here(pairs: ParameterScenarioGrid, places: NDArray[np.int64], report: Progress) -> bool:
        return _rollout(pairs, result, places, stride, max_slack, threads_of(workers), report)

    is_complete = fill(result, parts, run_here, rollout_portion, (stride, max_slack), workers, progress)
    return replace(result, interrupted=not is_complete)


def _empty_result(pairs: ParameterScenarioGrid, scenarios: int, stride: int) -> BatchResult:
    """An empty result for all sets of a grid in a number of scenarios."""
    shape, row_count = (pairs.shape[0], scenarios), kept_rows(pairs.shared.samples, stride)
    none = not_run(shape, metric_quantities(pairs.structure.metrics))
    columns = {name: np.full((*shape, row_count), np.nan) for name in pairs.loop.columns} if stride else {}
    return BatchResult(none.outcomes, none.end_times, none.metrics, columns)


def fill(
    result: RunOutcomes,
    grids: Sequence[tuple[Any, NDArray[np.int64], Progress]],
    run_here: Callable[[Any, NDArray[np.int64], Progress], bool],
    run_portion: Callable[..., RunOutcomes],
    options: tuple[Any, ...],
    workers: Workers,
    progress: Progress,
) -> bool:
    """Fill in a result, grid by grid on this machine or in portions on an executor's workers; False if interrupted.

    Args:
        result: to be filled in.
        grids: each grid, which divides itself by `portions` and `part`, with the places of its scenarios in the result
            and its receiver of progress.
        run_here: runs such a grid; False if interrupted.
        run_portion: runs a portion, from the arguments that `part` gives and the `options`.
        options: further arguments of a portion.
        workers: number of threads, or an executor.
        progress: receiver of an executor's progress.
    """
    if not isinstance(workers, Executor):
        return all(run_here(*each) for each in grids)
    places, run_count = list[tuple[NDArray[np.int64], ...]](), 0

    def tasks() -> Iterator[tuple[Any, ...]]:
        for grid, columns, _ in grids:
            for sets, scenes in grid.portions():
                places.append(np.ix_(sets, columns[scenes]))
                yield (*grid.part(sets, scenes), *options)

    try:
        for number, portion in spread(workers, run_portion, tasks()):
            result.put(places[number], portion)
            run_count += portion.outcomes.size
            progress(run_count / result.outcomes.size)
    except KeyboardInterrupt:
        return False
    return True


def rollout_portion(
    names: Sequence[str],
    parameters: Floats,
    scenarios: Scenarios,
    zeros: frozenset[str],
    stride: int,
    max_slack: float | None,
) -> BatchResult:
    """Run a part of a grid on one thread of a worker; arguments as in `rollout` and `ParameterScenarioGrid`."""
    pairs = ParameterScenarioGrid(names, parameters, scenarios, zeros)
    result = _empty_result(pairs, len(scenarios), stride)
    _rollout(pairs, result, np.arange(len(scenarios)), stride, max_slack, 1, no_progress)
    return result


def _rollout(
    pairs: ParameterScenarioGrid,
    result: BatchResult,
    places: NDArray[np.int64],
    stride: int,
    max_slack: float | None,
    threads: int | None,
    progress: Progress,
) -> bool:
    """Run the pairs of a structure and fill in their results; False if interrupted."""
    loop, samples, simulation = pairs.loop, pairs.shared.samples, pairs.shared.simulation
    slack = loop.states.index("metrics.slack")
    slack_limit = np.inf if max_slack is None else max_slack * samples
    compiled = simulation.engine == "compiled"
    run = compile_batch(loop, rows=stride > 0) if compiled else partial(_single_run, engine_of(loop, simulation.engine))
    kept_states = final_states(pairs.structure.metrics)
    final = np.full((len(kept_states), *pairs.shape), np.nan)
    summed = [loop.states.index(name) for name in kept_states]
    lanes = LANES if compiled else 1

    def block(indices: NDArray[np.int64]) -> None:
        filled = np.resize(indices, (lanes, 2))  # idle lanes repeat the block's pairs
        vectors = pairs.vectors(filled)
        numbers = filled[:, 1].tolist()
        state = pairs.starts(vectors, numbers)
        signals: list[Any] = [*pairs.sources(numbers)] if compiled else [*map(pairs.signals, numbers)]
        outcome, samples_run, rows = run(vectors, signals, state, samples, stride, watched=slack, most=slack_limit)
        busy, (sets, scenes) = slice(len(indices)), indices.T
        final[:, sets, scenes] = state[busy, summed].T
        at = sets, places[scenes]
        for index, name in enumerate(result.columns):
            result.columns[name][at] = rows[busy, :, index]
        result.end_times[at] = samples_run[busy] * simulation.sample_time
        result.outcomes[at] = words_of(outcome[busy])

    blocks = [pairs.indices[start : start + lanes] for start in range(0, len(pairs.indices), lanes)]
    completed_all = run_all([lambda indices=indices: block(indices) for indices in blocks], threads, progress)
    completed = result.completed[:, places]
    metrics = metrics_of(dict(zip(kept_states, final, strict=True)), completed=completed, own=pairs.metrics)
    for name, values in vars(metrics).items():
        result.metrics[name][:, places] = values
    return completed_all


LOOK_EVERY = 64
"""Approximate number of samples between two checks of the slack, as in compiled batches."""


def _single_run(
    run: Engine,
    parameters: Floats,
    signals: Sequence[Floats],
    state: Floats,
    samples: int,
    stride: int,
    *,
    watched: int,
    most: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """One run by another engine, with the interface of a compiled block of one lane (`codegen.drivers.batch.Batch`)."""
    step = max(stride, 1)
    length = samples if np.isinf(most) else step * -(-LOOK_EVERY // step)
    outcome, samples_run, pieces = Outcome.COMPLETED, 0, []
    while samples_run < samples and outcome == Outcome.COMPLETED:
        outcome, stepped, rows = run(parameters[0], signals[0][samples_run : samples_run + length], state[0], stride)
        samples_run += stepped
        pieces.append(rows)
        if outcome == Outcome.COMPLETED and samples_run < samples and state[0, watched] > most:
            outcome = Outcome.GIVEN_UP
    rows = np.full((kept_rows(samples, stride), pieces[0].shape[1]), np.nan)
    rows[: sum(map(len, pieces))] = np.concatenate(pieces)
    return np.array([outcome]), np.array([samples_run]), rows[np.newaxis]


BLOCKS = 2
"""Blocks of lanes per thread and portion: with only one, threads that finish early would wait for the others."""


def portion_size(experiment: Experiment, threads: int | None) -> tuple[int, int]:
    """Number of scenarios like `experiment` to run at a time, and number of threads.

    Args:
        experiment: a typical experiment.
        threads: maximum number of threads; default: one per core. Reduced where reference and given signals would take
            more than half of the memory.

    Raises:
        ConfigurationError: even the signals of a single thread do not fit.
    """
    room = memory_room()
    signal_count = sum(signal.given for signal, _ in given_signals(experiment.disturbance).values())
    signals = len(exogenous_names(experiment.controller))
    sample = 8 * (signals + LANES * signal_count)  # random signals are drawn during the run
    if experiment.samples * sample > room:
        raise ConfigurationError(
            f"simulation.duration = {experiment.duration:g}: must be <= "
            f"{room // sample * experiment.simulation.sample_time:.6g} s in an ensemble, to keep reference and "
            "given signals within half of the memory"
        )
    size = int(min(threads or cores(), room / (experiment.samples * sample)))
    return BLOCKS * LANES * size, size
