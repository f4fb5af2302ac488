"""Runs many jobs on threads; compiled code works there without Python's lock."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from dualwinch.simulation.batch.cores import cores


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
