"""Rates of the compiled code on this machine, beside a hand-written C loop of the same method, and their targets.

``python -m benchmarks`` times Case 4 (50 s at 1 kHz), its derivatives, batches and ensembles in turn and prints the
ratios (a minute); ``--write FILE`` puts them between the file's two marks.
"""

import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

import dualwinch as dw
from benchmarks.document import command, markdown, publish
from benchmarks.hand_c import MissingCompilerError, hand_adaptive
from dualwinch.codegen.compiler import vector_features
from dualwinch.codegen.drivers.batch import LANES, compile_batch
from dualwinch.codegen.errors import DualwinchError
from dualwinch.config.ensemble_file import reset
from dualwinch.simulation.batch.rollout import ParameterScenarioGrid
from dualwinch.simulation.batch.workers import cores, run_all
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.engine import engine_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of, zeros_of

BATCH, SEED = 64, 7
"""Rollouts of a batch, and seed of the ensembles' draws."""

GAIN = "controller.observer.l0"
"""The gain in which candidates differ."""

SLOPES = (
    *(f"controller.nftsm.{name}" for name in ("beta", "eta", "k", "phi")),
    *(f"controller.observer.{name}" for name in ("l0", "kf", "filter_time")),
    "controller.auxiliary.k_a",
    *(f"controller.winch_{number}.{name}" for number in (1, 2) for name in ("kp", "ki")),
)
"""Gains by which a rollout is differentiated."""

LANE_TARGETS = {"avx512f": 8.0, "avx2": 4.0}
"""Widest vector instructions → how many times the scalar loop's rate a batch is to reach on a core."""

MOST_TIME = 1.3
"""How many times the time of its compiled code `run_ensemble` is to take at most."""


@dataclass
class Timed:
    """A call that is timed.

    Attributes:
        title: what it computes.
        call: computes it.
        rollouts: how many rollouts that is.
        seconds: times of a rollout.
    """

    title: str
    call: Callable[[], object]
    rollouts: int = 1
    seconds: list[float] = field(default_factory=list)

    @property
    def shortest(self) -> float:
        """Least time of a rollout in s: what other work on the machine disturbed least."""
        return min(self.seconds)


def compiled_call(experiment: dw.Experiment) -> Callable[[], object]:
    """The compiled rollout alone, no rows kept, its inputs at hand."""
    structure, numbers = structure_of(experiment), parameters_of(experiment)
    run = engine_of(closed_loop(structure, zeros_of(structure, numbers)))
    parameters, signals = np.array(list(numbers.values())), exogenous_signals(experiment)
    start = np.array(list(initial_state_of(experiment).values()))
    return lambda: run(parameters, signals, start.copy(), 0)


def ensemble_of(name: str, duration: float) -> dw.Ensemble:
    """An ensemble with a Kalman filter."""
    return reset(dw.load_ensemble(name), {"controller.estimator": "kalman", "simulation.duration": duration})


def kernel(scenarios: list[dw.Scenario], threads: int) -> Callable[[], object]:
    """The compiled code alone for some scenarios that are ready; their signals are drawn as it goes."""
    grid = ParameterScenarioGrid([], np.empty((1, 0)), scenarios)
    run, jobs = compile_batch(grid.loop), []
    for first in range(0, len(scenarios), LANES):
        indices = np.resize(grid.indices[first : first + LANES], (LANES, 2))
        vectors = grid.vectors(indices)
        sources, state = grid.sources(indices[:, 1].tolist()), grid.starts(vectors, indices[:, 1])
        jobs.append(partial(_block, run, vectors, sources, state, grid.shared.samples))
    return partial(run_all, jobs, threads)


def _block(run: Callable[..., object], vectors: object, sources: object, state: np.ndarray, samples: int) -> None:
    run(vectors, sources, state.copy(), samples)


def timed_calls(duration: float) -> dict[str, Timed]:
    """All calls by a short name, compiled."""
    case, threads = dw.override(dw.case(4), {"simulation.duration": duration}), cores()
    gains = 5.0 * np.linspace(1, 2, BATCH)[:, None]
    slopes = [[parameters_of(case)[name] for name in SLOPES]]
    calls = {
        "hand": Timed("hand-written C loop", hand_adaptive(case)),
        "run": Timed("Case 4, the C call alone", compiled_call(case)),
        "slopes": Timed(
            "the same with its slopes by 12 gains", lambda: dw.sensitivities(SLOPES, slopes, [case], workers=1)
        ),
    }
    for count in sorted({1, threads}):
        batch = partial(dw.rollout, [GAIN], gains, [case], workers=count)
        calls[f"batch-{count}"] = Timed(f"batch of {BATCH}, threads: {count}", batch, BATCH)
    for name in ("sea", "rig"):
        ensemble = ensemble_of(name, duration)
        few, many = ensemble.chosen(range(LANES), SEED), ensemble.chosen(range(BATCH), SEED)
        batch = partial(dw.rollout, [GAIN], gains[: BATCH // LANES], few, workers=1)
        whole = partial(dw.run_ensemble, ensemble, BATCH, SEED, traces=False, workers=threads)
        calls[name] = Timed(f"`{name}` with Kalman filter, batch of {BATCH}, threads: 1", batch, BATCH)
        calls[f"{name}-kernel"] = Timed(
            f"`{name}`, {BATCH} scenarios, compiled code alone", kernel(many, threads), BATCH
        )
        calls[f"{name}-whole"] = Timed("the same by `run_ensemble`, draws included", whole, BATCH)
    return calls


def targets(features: tuple[str, ...], threads: int) -> list[tuple[str, str, float | None]]:
    """What is compared with what, and the least ratio of their rates."""
    widest = next((name for name in LANE_TARGETS if name in features), "")
    several = [(f"batch-{threads}", "batch-1", 0.9 * threads)] if threads > 1 else []
    return [
        ("run", "hand", 1.0),
        ("slopes", "run", 0.25),
        ("batch-1", "hand", LANE_TARGETS.get(widest)),
        *several,
        ("sea", "batch-1", 0.75),
        ("rig", "batch-1", 0.5),
        ("sea-whole", "sea-kernel", 1 / MOST_TIME),
        ("rig-whole", "rig-kernel", 1 / MOST_TIME),
    ]


def table(calls: dict[str, Timed], features: tuple[str, ...], threads: int) -> str:
    """Ratios of rates beside their targets."""
    rows = []
    for name, other, least in targets(features, threads):
        ratio = calls[other].shortest / calls[name].shortest
        limit = f"none for {platform.machine()}" if least is None else f"{least:.2g} ×"
        verdict = "" if least is None else "yes" if ratio >= least else "no"
        cells = [f"{1e3 * calls[name].shortest:.3g} ms", calls[other].title, f"{ratio:.2f} ×", limit, verdict]
        rows.append([calls[name].title, *cells])
    return markdown(["what", "a rollout", "rate over that of", "", "at least", ""], rows)


def measure(calls: dict[str, Timed], rounds: int) -> None:
    """Time all calls in turn; a round ahead warms up and does not count."""
    for number in range(rounds + 1):
        for timed in calls.values():
            begin = time.perf_counter()
            timed.call()
            if number:
                timed.seconds.append((time.perf_counter() - begin) / timed.rollouts)


def main() -> int:
    """Run the command line; 0 done, 1 where a compiler is missing."""
    parser = command(__doc__)
    parser.add_argument("--rounds", type=int, default=11, metavar="N", help="rounds in which calls take turns (11)")
    parser.add_argument("--duration", type=float, default=50.0, metavar="S", help="simulated time (50 s)")
    arguments = parser.parse_args()
    if arguments.rounds < 1:
        parser.error(f"--rounds {arguments.rounds}: must be >= 1")
    try:
        calls = timed_calls(arguments.duration)
        measure(calls, arguments.rounds)
    except (DualwinchError, MissingCompilerError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    publish(arguments.write, {"rates": table(calls, vector_features(), cores())})
    return 0


if __name__ == "__main__":
    sys.exit(main())
