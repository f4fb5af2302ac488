"""Run an ensemble: scenario after scenario on all cores, in memory that does not grow with their number."""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from simulation.check import check
from simulation.closed_loop import closed_loop
from simulation.cores import cores
from simulation.engine import engine
from simulation.ensemble import Ensemble, Scenario
from simulation.ensemble_collector import TRACED, Collector, Finished
from simulation.ensemble_result import EnsembleResult
from simulation.errors import ConfigurationError
from simulation.simulate import simulate
from simulation.structure import parameters_of, structure_of, zeros_of

POINTS = 500
"""Instants of a trace."""

LARGEST = 1e30
"""Magnitude a trace is limited to, within the range of single precision."""

AHEAD = 2
"""Scenarios a worker has waiting, so that none idles and few are lost by an interrupt."""


def rollout_scenarios(
    scenarios: Iterable[Scenario], points: int = 0, workers: int | None = None
) -> Generator[Finished, None, None]:
    """Run scenarios of one structure in threads, and give them back in their order.

    Args:
        scenarios: drawn one by one as they are needed.
        points: instants of the traces, at most; 0 keeps none.
        workers: threads (default: one a core); the compiled code runs without Python's lock.

    Raises:
        ConfigurationError: the values of a scenario do not fit together; the message names its number.
        DualwinchError: no compiler, or no usable cache folder.
    """
    threads = workers or cores()
    waiting: deque[Future[Finished]] = deque()
    pool = ThreadPoolExecutor(threads)
    try:
        for scenario in scenarios:
            _compile(scenario)
            waiting.append(pool.submit(_run, scenario, points))
            if len(waiting) >= AHEAD * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def _compile(scenario: Scenario) -> None:
    """What `_run` will ask for, made before the threads want it: CasADi builds expressions in one thread only."""
    zeros = zeros_of(parameters_of(scenario.experiment, scenario.nominal))
    engine(closed_loop(structure_of(scenario.experiment), zeros))


def _run(scenario: Scenario, points: int) -> Finished:
    experiment = scenario.experiment
    stride = -(-experiment.samples // points) if points else 0
    try:
        result = simulate(experiment, nominal=scenario.nominal, stride=stride)
    except ConfigurationError as error:
        raise ConfigurationError(f"scenario {scenario.index}: {error}") from error
    trace = np.array([result[column].clip(-LARGEST, LARGEST) for column in TRACED], dtype=np.float32)
    return Finished(scenario, result.metrics, result.outcome, result.end_time, result["t"], trace)


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
        progress: called after each scenario with the number that are done.

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
        for one in finished:
            kept.add(one)
            if progress:
                progress(len(kept))
    except KeyboardInterrupt:
        if not len(kept):
            raise
    finally:
        finished.close()
    return kept.result(seed, scenarios)
