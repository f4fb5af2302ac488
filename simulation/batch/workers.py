"""Where many runs are computed: on threads of this machine, or by the workers of an executor.

Everything that takes ``workers=`` takes a number of threads (compiled code runs without Python's lock) or a
`concurrent.futures.Executor`, such as a ``ProcessPoolExecutor`` or Dask's ``client.get_executor()``. What is many runs
is then split into portions that do not depend on the number of workers, and the portions' results are put together by
their numbers, so that the result is the same bits for all workers and orders.
"""

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from functools import partial
from itertools import islice
from queue import SimpleQueue
from typing import Any, TypeAlias, TypeVar

from dualwinch.codegen.errors import DualwinchError
from dualwinch.codegen.text import one_line
from dualwinch.simulation.batch.task import WorkerError, WorkerTask, run_task

Item = TypeVar("Item")

Outcome = TypeVar("Outcome")

Workers: TypeAlias = int | Executor | None
"""Threads of this machine (None: one a core), or an executor."""


def threads_of(workers: Workers) -> int | None:
    """Threads of what is computed on this machine in any case: as many as asked for, else one a core."""
    return workers if isinstance(workers, int) else None


def run_all(
    jobs: Sequence[Callable[[], None]], threads: int | None = None, progress: Callable[[float], None] | None = None
) -> bool:
    """Run jobs on threads; an interrupt lets those under way finish and drops the rest.

    Args:
        jobs: what is run.
        threads: default: one a core.
        progress: called now and then with the share that is done.

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


def map_all(work: Callable[[Item], Outcome], items: Sequence[Item], threads: int | None = None) -> list[Outcome]:
    """What some work makes of each of some items, on threads, in their order.

    Args:
        work: what is run.
        items: what it is run on.
        threads: default: one a core.

    Raises:
        KeyboardInterrupt: interrupted; work under way is finished.
    """
    found: dict[int, Outcome] = {}

    def one(index: int) -> None:
        found[index] = work(items[index])

    if not run_all([partial(one, index) for index in range(len(items))], threads):
        raise KeyboardInterrupt
    return [found[index] for index in range(len(items))]


def cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def portion_of(runs: int, *, portions: int = 64, least: int = 64, most: int = 512) -> int:
    """Number of runs of a task, a multiple of `least`: small enough for many workers, large enough to be worth it.

    Args:
        runs: of all tasks.
        portions: number of tasks that are aimed at, so that so many workers have something to do.
        least: runs of a task, below which sending it costs more than a few per cent of computing it.
        most: runs of a task, beyond which nothing is gained, and more is lost with a worker.
    """
    return min(max(least, -(-runs // (portions * least)) * least), most)


def spread(
    executor: Executor,
    work: Callable[..., Outcome],
    tasks: Iterable[tuple[Any, ...]],
    *,
    at_once: int = 4096,
) -> Generator[tuple[int, Outcome], None, None]:
    """Have tasks computed by an executor's workers; numbers of tasks and their results, as they come.

    To schedule, to move data, and to repeat what a lost worker had begun, is the executor's. When the iteration ends
    early, by an error or an interrupt, tasks that are not finished are cancelled.

    Args:
        executor: of the workers; it is not shut down.
        work: a function at the top of a module.
        tasks: its arguments. Threads of this process get them as they are, others as a `WorkerTask`.
        at_once: number of tasks that the executor knows at a time, which bounds the memory here.

    Raises:
        WorkerError: workers were lost again and again, ran out of memory, cannot compile, or are of another version.
        DualwinchError: as raised by the work.
    """
    numbered, waiting = enumerate(tasks), dict[Future[Outcome], int]()
    done: SimpleQueue[Future[Outcome]] = SimpleQueue()

    def submit(count: int) -> None:
        for number, arguments in islice(numbered, count):
            if isinstance(executor, ThreadPoolExecutor):
                future = executor.submit(work, *arguments)
            else:
                future = executor.submit(run_task, WorkerTask.of(work, *arguments))
            waiting[future] = number
            future.add_done_callback(done.put)

    try:
        submit(at_once)
        while waiting:
            future = done.get()
            yield waiting.pop(future), future.result()
            submit(1)
    except (CancelledError, BrokenExecutor, MemoryError) as error:
        raise WorkerError(f"workers: {_reason(error)}") from error
    except Exception as error:
        if isinstance(error, DualwinchError) or not type(error).__module__.startswith("distributed"):
            raise
        raise WorkerError(f"workers: {_reason(error)}") from error
    finally:
        for future in waiting:
            future.cancel()


def _reason(error: BaseException) -> str:
    """Why workers did not compute a task, in one line."""
    if isinstance(error, MemoryError):
        return "a worker ran out of memory"
    if isinstance(error, CancelledError):
        return "the scheduler has dropped a task: it was stopped or started anew, or the client lost it"
    if type(error).__name__ in {"KilledWorker", "BrokenProcessPool"}:
        return "each worker that began a task died of it: killed, or out of memory (their logs say which)"
    return one_line(f"{type(error).__name__}: {error}")


def in_order(numbered: Iterator[tuple[int, Outcome]]) -> Iterator[Outcome]:
    """Results of numbered tasks in the order of their numbers, each as soon as all before it are there."""
    early, following = dict[int, Outcome](), 0
    for number, result in numbered:
        early[number] = result
        while following in early:
            yield early.pop(following)
            following += 1
