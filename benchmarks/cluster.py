"""Many runs on a Dask cluster: efficiency, what a task and a run cost, where the scheduler is the limit, last bits.

``python -m benchmarks.cluster`` prints the tables; ``--write FILE`` puts each between its two marks in a file.
Scheduler and workers are processes of this machine, on loopback.
"""

import argparse
import os
import pickle
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from distributed import Client, LocalCluster

from benchmarks.document import markdown, put
from dualwinch.codegen.compiler import processor_name
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.simulation.batch.task import WorkerTask
from dualwinch.simulation.batch.workers import cores, portion_of, spread
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.run import TRACE_POINTS, ensemble_portion, run_ensemble, whole
from dualwinch.simulation.ensembles.streamed import ensemble_statistics, portion_statistics

RUNS, SEED = 20_000, 1

ASLEEP = 0.5
"""Time in s for which a task of a simulated worker sleeps."""

COMPILERS = {
    "AVX-512": "gcc -march=native",
    "AVX2": "gcc -march=haswell",
    "no fused products": "gcc -march=x86-64-v2",
    "clang": "clang -march=native",
    "zig": "zig",
}
"""What lanes are compiled with; the others are compared with the first."""


@contextmanager
def cluster(workers: int, threads: int = 1) -> Iterator[Executor]:
    """A scheduler, and so many worker processes of so many threads."""
    local = LocalCluster(n_workers=workers, threads_per_worker=threads, dashboard_address="", memory_limit=0)
    with local, Client(local) as client:
        yield client.get_executor(pure=False)


def shortest(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Wall time in s of each call: the shortest of some rounds, after one that warms up."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(rounds + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            if turn:
                taken[name].append(time.perf_counter() - begin)
    return {name: min(times) for name, times in taken.items()}


def processor_time() -> float:
    """Processor time in s of this process and of those that it has started."""
    own = psutil.Process()
    times = [each.cpu_times() for each in (own, *own.children(recursive=True))]
    return sum(each.user + each.system for each in times)


def efficiency(ensemble: Ensemble) -> tuple[str, float]:
    """Worker processes beside as many threads of this process, as a table; processor time in s of a run.

    The efficiency is by processor time, scheduler and client included, which other work on the machine hardly changes.
    """
    rows, seconds = [], 0.0
    for count in (1, 2):
        with cluster(count) as executor:
            taken = []
            for workers in (count, executor):
                run_ensemble(ensemble, 640, SEED, traces=False, workers=workers)
                wall, before = time.perf_counter(), processor_time()
                run_ensemble(ensemble, RUNS, SEED, traces=False, workers=workers)
                taken.append((time.perf_counter() - wall, processor_time() - before))
        (wall, here), (wall_there, there) = taken
        seconds = seconds or here / RUNS
        rows.append(
            [
                str(count),
                f"{wall:.1f} s",
                f"{wall_there:.1f} s",
                f"{here:.1f} s",
                f"{there:.1f} s",
                f"{here / there:.2f}",
            ]
        )
    headings = [
        "threads, or worker processes",
        "threads",
        "Dask processes",
        "threads, processor time",
        "Dask processes, processor time",
        "efficiency",
    ]
    return markdown(headings, rows), seconds


def task_cost() -> float:
    """Time in s of a task that does nothing, one after the other on one worker."""
    with cluster(1) as executor:
        empty = shortest({"empty": lambda: list(spread(executor, abs, ((number,) for number in range(1000))))}, 2)
    return empty["empty"] / 1000


def sleeping(counts: tuple[int, ...]) -> Iterator[tuple[int, float]]:
    """Tasks a second that so many simulated workers get done, each of which sleeps `ASLEEP` a task."""
    for count in counts:
        with cluster(2, count // 2) as executor:
            tasks = 4 * count
            list(spread(executor, time.sleep, ((0.0,) for _ in range(100))))
            begin = time.perf_counter()
            list(spread(executor, time.sleep, ((ASLEEP,) for _ in range(tasks))))
            yield count, tasks / (time.perf_counter() - begin)


def limit() -> tuple[str, float]:
    """Simulated workers as a table, and the largest number of tasks a second."""
    found = list(sleeping((10, 100, 400, 1000)))
    rows = [
        [str(count), f"{count / ASLEEP:.0f}", f"{rate:.0f}", f"{rate * ASLEEP / count:.2f}"] for count, rate in found
    ]
    headings = ["simulated workers", "tasks a second without a limit", "tasks a second", "efficiency"]
    return markdown(headings, rows), max(rate for _, rate in found)


def traffic(ensemble: Ensemble) -> str:
    """Bytes that travel for a run, there and back, as a table."""
    size, rows = portion_of(RUNS), []
    stride = -(-ensemble.experiment.samples // TRACE_POINTS)
    indices = range(4 * size, 5 * size)
    for name, every, reduced in (
        ("`run_ensemble`, metrics and draws", 0, whole),
        ("`run_ensemble`, traces, beyond the first 2000 runs", stride, whole),
        ("`ensemble_statistics`", 0, partial(portion_statistics, ensemble, SEED, 1e-3)),
    ):
        start = 10 * size if "beyond" in name else 0
        arguments: list[Any] = [[ensemble], range(indices.start + start, indices.stop + start), SEED, every, reduced]
        there = len(pickle.dumps(WorkerTask.of(ensemble_portion, *arguments)))
        back = len(pickle.dumps(ensemble_portion(*arguments)))
        rows.append([name, f"{there / size:.0f} B", f"{back / size:.0f} B"])
    return markdown([f"a portion of {size} runs", "to the worker, a run", "back, a run"], rows)


def model(seconds: float, overhead: float, rate: float) -> str:
    """Runs a second of many workers, by portion size, as a table."""
    rows = []
    for size, workers in product((64, 512), (10, 100, 1000)):
        portion = size * seconds
        alone = portion / (portion + overhead)
        possible = min(1.0, rate * (portion + overhead) / workers)
        limited = "the scheduler" if possible < 1 else "the workers"
        rows.append(
            [
                str(size),
                str(workers),
                f"{workers / (portion + overhead) * possible * size:,.0f}".replace(",", " "),
                f"{alone * possible:.2f}",
                limited,
            ]
        )
    return markdown(["runs a portion", "workers", "runs a second", "efficiency", "the limit"], rows)


def resident(runs: int) -> float:
    """Memory in MB that this process holds behind the statistics of so many short runs."""
    short = reset(load_ensemble("sea"), {"simulation.duration": 0.01})
    ensemble_statistics(short, runs, SEED)
    return psutil.Process().memory_info().rss / 1e6


def memory(counts: tuple[int, ...]) -> str:
    """Memory of a client of its own, as a table."""
    rows = []
    for count in counts:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            rows.append([f"{count:,}".replace(",", " "), f"{pool.submit(resident, count).result():.0f} MB"])
    return markdown(["runs of `ensemble_statistics`", "memory of the process"], rows)


def metrics_with(compiler: str, name: str, *, exact: bool) -> tuple[dict[str, np.ndarray], float]:
    """Figures of merit of 128 runs by a compiler, and processor time in s of a run; in a process of its own."""
    os.environ |= {"DUALWINCH_CC": compiler, "DUALWINCH_EXACT": str(int(exact))}
    ensemble = load_ensemble(name)
    run_ensemble(ensemble, 16, SEED, traces=False, workers=1)
    found, times = run_ensemble(ensemble, 128, SEED, traces=False, workers=1), []
    for _ in range(3):
        begin = time.process_time()
        run_ensemble(ensemble, 128, SEED, traces=False, workers=1)
        times.append(time.process_time() - begin)
    return found.metrics, min(times) / 128


def bits(name: str) -> str:
    """Values that differ between processors and compilers, as a table."""
    rows = []
    for exact in (False, True):
        first: dict[str, np.ndarray] = {}
        for label, compiler in COMPILERS.items():
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                found, seconds = pool.submit(metrics_with, compiler, name, exact=exact).result()
            first = first or found
            pairs = [(first[key][np.isfinite(first[key])], found[key][np.isfinite(first[key])]) for key in first]
            differ = sum(int((ours != theirs).sum()) for ours, theirs in pairs)
            apart = [abs(ours - theirs) / np.maximum(abs(ours), 1e-300) for ours, theirs in pairs]
            largest = float(np.concatenate(apart).max())
            count = sum(len(ours) for ours, _ in pairs)
            rows.append(
                [
                    "`--exact`" if exact else "as usual",
                    label,
                    f"{differ} of {count}",
                    f"{largest:.1e}" if differ else "0",
                    f"{1e3 * seconds:.2f} ms",
                ]
            )
    return markdown(["", "compiled for", "values that differ", "largest, relative", "processor time, a run"], rows)


def main() -> None:
    """Print or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="file with the marks")
    parser.add_argument("--runs", type=int, default=1_000_000, help="most runs whose memory is looked at")
    chosen = parser.parse_args()
    sea = load_ensemble("sea")

    def show(mark: str, table: str) -> None:
        print(f"{table}\n", flush=True)
        if chosen.write:
            put(chosen.write, mark, table)

    show("traffic", traffic(sea))
    table, seconds = efficiency(sea)
    load = f"{processor_name()}, {cores()} cores, on which other work was under way (load {os.getloadavg()[0]:.0f})."
    show("efficiency", f"{table}\n\n{load}")
    overhead = task_cost()
    table, rate = limit()
    cost = (
        f"A task that does nothing takes {1e3 * overhead:.1f} ms of a worker, one after the other; a portion of "
        f"{portion_of(RUNS)} runs takes {portion_of(RUNS) * seconds:.2f} s."
    )
    show("limit", f"{cost}\n\n{table}")
    show("model", model(seconds, overhead, rate))
    show("bits", bits("rig"))
    show("memory", memory((1000, chosen.runs // 10, chosen.runs)))


if __name__ == "__main__":
    main()
