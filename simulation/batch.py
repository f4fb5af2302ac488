"""Many rollouts in one call: every set of parameters in every scenario, on all cores and in all vector lanes."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from codegen.batch import LANES, compile_batch
from model.quantity import with_leaves
from simulation.batch_check import check_batch
from simulation.closed_loop import closed_loop, initial_state_of
from simulation.cores import cores
from simulation.ensemble import Scenario
from simulation.experiment import Experiment
from simulation.kept_signals import signals
from simulation.metrics import Metrics, metrics_of
from simulation.simulate import OUTCOMES
from simulation.structure import parameters_of, structure_of, zeros_of

Floats = NDArray[np.float64]

NOT_RUN = "not_run"
"""Outcome of a pair that an interrupt left out."""

SHAPE_THE_START = ("plant.", "sensors.", "controller.coordination.")
"""Parameters that the initial state depends on: the ropes' stretch at rest, and how the encoders read it."""


@dataclass(frozen=True)
class BatchResult:
    """What a batch gave, for every set of parameters (n) in every scenario (m).

    Attributes:
        outcomes: (n, m) words: ``completed``, ``diverged``, ``left_track`` or, after an interrupt, ``not_run``.
        end_times: (n, m) in s.
        metrics: name → (n, m), as in `Metrics`; NaN where a pair was not run.
        columns: name → (n, m, kept) where rows were asked for, NaN after an early end; else empty.
        interrupted: whether an interrupt ended the batch, even if every pair was under way by then and is finished.
    """

    outcomes: NDArray[np.str_]
    end_times: Floats
    metrics: dict[str, Floats]
    columns: dict[str, Floats]
    interrupted: bool = False


def rollout(
    names: Sequence[str],
    parameters: ArrayLike,
    scenarios: Sequence[Experiment | Scenario],
    *,
    stride: int = 0,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> BatchResult:
    """Run every set of parameters in every scenario.

    A pair's result depends on nothing but the pair: not on its neighbours, its lane, the number of pairs or threads.
    It equals `simulate`'s up to rounding (the elementary functions differ in their last bits).

    Args:
        names: keys of the parameters that vary, e.g. ``["controller.nftsm.beta", "controller.observer.l0"]``. A
            ``plant.*`` leaves the plant the controller believes in as the scenario has it (``nominal.*``).
        parameters: (n, len(names)), a value for each name.
        scenarios: m experiments, or draws of an ensemble (whose controller believes in the undrawn plant), of one
            structure and length; they give every other value.
        stride: every how many samples a row is kept; 0 keeps none.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        The result; an interrupt (Ctrl-C) leaves what is finished, and ``not_run`` for the rest.

    Raises:
        ConfigurationError: an unknown name, a wrong shape, or scenarios that do not go together.
        DualwinchError: no compiler, or no usable cache folder.
    """
    values = np.asarray(parameters, float)
    experiments = [one.experiment if isinstance(one, Scenario) else one for one in scenarios]
    believed = [one.nominal if isinstance(one, Scenario) else None for one in scenarios]
    check_batch(names, values, scenarios)
    drawn = {key for one in scenarios if isinstance(one, Scenario) for key in one.draws}
    numbers = [parameters_of(one, nominal) for one, nominal in zip(experiments, believed, strict=True)]
    loop = closed_loop(structure_of(experiments[0]), zeros_of(*numbers, varying=[*names, *drawn]))
    run = compile_batch(loop)
    places = [loop.parameters.index(name) for name in names]
    pairs = [(i, j) for j in range(len(scenarios)) for i in range(len(values))]
    samples, sample_time = experiments[0].samples, experiments[0].simulation.sample_time
    vectors = np.array([list(one.values()) for one in numbers])
    shaping = [place for place, name in enumerate(names) if name.startswith(SHAPE_THE_START)]
    start = lru_cache(maxsize=4 * LANES)(
        lambda j, chosen: _start(experiments[j], dict(zip([names[place] for place in shaping], chosen, strict=True)))
    )
    shape = len(values), len(scenarios)
    kept = -(-samples // stride) if stride else 0
    result = BatchResult(
        outcomes=np.full(shape, NOT_RUN, dtype="U10"),
        end_times=np.full(shape, np.nan),
        metrics={field.name: np.full(shape, np.nan) for field in fields(Metrics)},
        columns={name: np.full((*shape, kept), np.nan) for name in loop.columns} if stride else {},
    )

    def block(chosen: list[tuple[int, int]]) -> None:
        filled = (chosen * LANES)[:LANES]  # idle lanes repeat the block's pairs
        vector = vectors[[j for _, j in filled]]
        vector[:, places] = values[[i for i, _ in filled]]
        state = np.array([start(j, tuple(values[i, shaping].tolist())) for i, j in filled])
        tables = {j: signals(experiments[j]) for j in {j for _, j in filled}}
        outcome, done, rows = run(vector, [tables[j] for _, j in filled], state, stride)
        for lane, (i, j) in enumerate(chosen):
            final = dict(zip(loop.states, state[lane].tolist(), strict=True))
            metrics = metrics_of(final)
            for name, table in result.metrics.items():
                table[i, j] = getattr(metrics, name)
            for place, name in enumerate(loop.columns if stride else ()):
                result.columns[name][i, j] = rows[lane, :, place]
            result.end_times[i, j] = done[lane] * sample_time
            result.outcomes[i, j] = OUTCOMES[outcome[lane]]

    blocks = [pairs[first : first + LANES] for first in range(0, len(pairs), LANES)]
    whole = _run_all([lambda chosen=chosen: block(chosen) for chosen in blocks], threads, progress)
    return replace(result, interrupted=not whole)


def _start(scenario: Experiment, changes: dict[str, float]) -> Floats:
    return np.array(list(initial_state_of(with_leaves(scenario, changes)).values()))


def _run_all(jobs: list[Callable[[], None]], threads: int | None, progress: Callable[[float], None] | None) -> bool:
    """Run jobs on threads; an interrupt lets those under way finish and drops the rest.

    Returns:
        Whether there was no interrupt.
    """
    pool = ThreadPoolExecutor(threads or cores())
    waiting: set[Future[None]] = {pool.submit(job) for job in jobs}
    try:
        while waiting:
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                future.result()
            if progress:
                progress(1 - len(waiting) / len(jobs))
    except KeyboardInterrupt:
        return False
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return True
