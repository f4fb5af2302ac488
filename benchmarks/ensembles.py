"""What `run_ensemble` takes beside its compiled code, and how much memory.

``python -m benchmarks.ensembles`` prints the table; ``--write FILE`` puts it between the file's two marks. Times are
the processor's, of all threads, so that other work on the machine counts little; memory is the most that a process of
its own ever held.
"""

import argparse
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from benchmarks.case import Case
from benchmarks.document import markdown, put
from benchmarks.limits import MOST_TIME
from benchmarks.peers import ENSEMBLES
from benchmarks.peers.ensembles import SEED, ensemble_of, kernel
from benchmarks.report import machine
from dualwinch.codegen.errors import DualwinchError
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.experiment import Simulation

TIMED = 256
"""Scenarios of a timed call."""

COUNTS = (1000, 10_000)
"""Scenarios whose memory is looked at."""

HEADINGS = ["ensemble", "compiled code, a scenario", "run_ensemble, a scenario", "over", "at most", ""]


def case_of(duration: float) -> Case:
    """The product's own method, over a duration in s."""
    return Case(duration, Simulation.integrator, Simulation.substeps)


def times(name: str, duration: float, rounds: int) -> tuple[float, float]:
    """Processor time in s of a scenario, by the compiled code alone and by `run_ensemble`: the least of some rounds."""
    ensemble = ensemble_of(name, case_of(duration))
    alone = kernel(ensemble.chosen(range(TIMED), SEED), cores())

    def whole() -> None:
        run_ensemble(ensemble, TIMED, SEED, traces=False)

    taken = [(_processor_time(alone), _processor_time(whole)) for _ in range(rounds + 1)][1:]  # the first one warms up
    compiled, all_of_it = (min(each) / TIMED for each in zip(*taken, strict=True))
    return compiled, all_of_it


def _processor_time(call: Callable[[], object]) -> float:
    begin = time.process_time()
    call()
    return time.process_time() - begin


def memory(name: str, duration: float, count: int) -> float:
    """The most memory in MB that a process ever held that ran so many scenarios and did nothing else."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(_peak, name, duration, count).result()


def _peak(name: str, duration: float, count: int) -> float:
    run_ensemble(ensemble_of(name, case_of(duration)), count, SEED)
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return held / 2**20 if sys.platform == "darwin" else held / 2**10


def row(name: str, duration: float, rounds: int) -> list[str]:
    """A row of the table."""
    compiled, whole = times(name, duration, rounds)
    held = [f"{memory(name, duration, count):.0f} MB" for count in COUNTS]
    ratio = whole / compiled
    verdict = "yes" if ratio <= MOST_TIME else "no"
    numbers = [f"{compiled * 1e3:.2f} ms", f"{whole * 1e3:.2f} ms", f"{ratio:.2f} ×", f"{MOST_TIME} ×"]
    return [name, *numbers, verdict, *held]


def main() -> int:
    """Run the command line; 0 done, 1 where dualwinch cannot run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, metavar="N", help="number of interleaved rounds (9)")
    parser.add_argument("--duration", type=float, default=50.0, metavar="S", help="simulated time (50 s)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    if chosen.rounds < 1:
        parser.error(f"--rounds {chosen.rounds}: must be >= 1")
    try:
        rows = [row(name, chosen.duration, chosen.rounds) for name in ENSEMBLES]
    except DualwinchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    facts = " · ".join(f"{name}: {value}" for name, value in machine().items())
    text = f"{markdown([*HEADINGS, *(f'memory, {count} scenarios' for count in COUNTS)], rows)}\n\n*{facts}*"
    print(text)
    if chosen.write:
        put(chosen.write, "ensembles", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
