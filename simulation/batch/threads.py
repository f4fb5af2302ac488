"""Jobs on threads, as many as there are cores: compiled code works there without Python's lock."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import partial
from typing import TypeVar

Item = TypeVar("Item")

Outcome = TypeVar("Outcome")


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
