"""Compute many runs on threads of this machine, or on the workers of an executor, such as a Dask cluster.

Every ``workers=`` argument accepts a number of threads (compiled code runs without Python's lock) or a
`concurrent.futures.Executor`, such as a ``ProcessPoolExecutor`` or Dask's ``client.get_executor()``. The runs are then
split into portions that do not depend on the number of workers, and results are assembled by portion number, so that
they are the same bits for any number of workers and any order. A `CheckpointingExecutor` stores finished portions, so
that interrupted work can be resumed by calling it again.

An executor may have a method ``exclude(error)``: it is told of a `WorkerCompileError`, and the task is submitted again.
It raises the error if no worker is left (`toolboxes.cluster`).
"""

import os
import pickle
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, as_completed
from contextvars import copy_context
from functools import partial
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeAlias, TypeVar

from dualwinch.codegen.errors import DualwinchError
from dualwinch.codegen.files import atomic
from dualwinch.codegen.text import one_line
from dualwinch.model.arguments import whole_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.task import WorkerCompileError, WorkerError, WorkerTask, run_task
from dualwinch.simulation.progress import Progress, no_progress

Item = TypeVar("Item")

Returned = TypeVar("Returned")

Workers: TypeAlias = int | Executor | None
"""Number of threads on this machine (None: one per core), or an executor."""


def threads_of(workers: Workers) -> int | None:
    """Number of threads for work that always runs on this machine; None, one per core, if `workers` is an executor."""
    if workers is None or isinstance(workers, Executor):
        return None
    return whole_number("workers", workers, 1)


def run_all(jobs: Sequence[Callable[[], None]], threads: int | None = None, progress: Progress = no_progress) -> bool:
    """Run jobs on threads (default: one per core); after an interrupt, running jobs finish and the rest is dropped.

    Returns:
        False if interrupted.
    """
    pool = ThreadPoolExecutor(threads or cores())
    futures = [pool.submit(copy_context().run, job) for job in jobs]
    try:
        for count, future in enumerate(as_completed(futures), 1):
            future.result()
            progress(count / len(jobs))
    except KeyboardInterrupt:
        return False
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return True


def map_all(work: Callable[[Item], Returned], items: Sequence[Item], threads: int | None = None) -> list[Returned]:
    """Apply a function to items on threads (default: one per core); results are in the order of the items.

    Raises:
        KeyboardInterrupt: interrupted, after running calls have finished.
    """
    results: dict[int, Returned] = {}

    def compute(index: int) -> None:
        results[index] = work(items[index])

    if not run_all([partial(compute, index) for index in range(len(items))], threads):
        raise KeyboardInterrupt
    return [results[index] for index in range(len(items))]


def cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


PORTIONS, LARGEST_PORTION = 64, 512
"""Desired number of tasks, and so of busy workers; runs per task beyond which more is only lost with a worker."""


def portion_of(runs: int, *, least: int = 64) -> int:
    """Number of runs per task, a multiple of `least`, with fewer of which sending costs more than a few per cent."""
    return min(max(least, -(-runs // (PORTIONS * least)) * least), LARGEST_PORTION)


class WorkerWarning(UserWarning):
    """A worker cannot compile; others take over its tasks."""


class CheckpointingExecutor(Executor):
    """An executor with a folder that stores the results of its tasks, so that work can be resumed after an interrupt.

    A result is identified by a digest of function, arguments, users' parts and versions, on any machine; a task that
    differs in any of these is computed. Files are pickles: nobody else may have write access to the folder. It may be
    deleted when the work is done.

    Args:
        executor: executor that computes; it is not shut down.
        folder: folder for results; created if missing.

    Raises:
        ConfigurationError: the folder cannot be created.
    """

    def __init__(self, executor: Executor, folder: Path | str) -> None:
        self.executor, self.folder = executor, Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(f"{folder}: cannot be made ({error.strerror})") from error

    def submit(self, fn: Callable[..., Returned], /, *args: Any, **kwargs: Any) -> Future[Returned]:
        """Compute a call with the executor."""
        return self.executor.submit(fn, *args, **kwargs)

    def has(self, key: str) -> bool:
        """Whether the result of a task is stored."""
        return self._file(key).is_file()

    def load(self, key: str) -> tuple[Any, ...]:
        """The stored result of a task, alone in a tuple; empty if there is none or it cannot be read."""
        try:
            return (pickle.loads(self._file(key).read_bytes()),)  # noqa: S301  the user's own folder
        except Exception:  # noqa: BLE001  damaged in any way: computed anew
            return ()

    def store(self, key: str, result: object) -> None:
        """Store the result of a task; its file appears whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        with atomic(self._file(key)) as unfinished:
            unfinished.write_bytes(pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL))

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}.result"


class SerialExecutor(Executor):
    """Computes each task in the calling thread as it is submitted; what the task raises is raised there, too."""

    def submit(self, fn: Callable[..., Returned], /, *args: Any, **kwargs: Any) -> Future[Returned]:
        """Compute a call."""
        future = Future[Returned]()
        future.set_result(fn(*args, **kwargs))
        return future


def spread(
    executor: Executor,
    work: Callable[..., Returned],
    tasks: Iterable[tuple[Any, ...]],
    *,
    at_once: int = 4096,
) -> Generator[tuple[int, Returned], None, None]:
    """Compute tasks on an executor's workers; yield task numbers and results in the order in which they finish.

    The executor schedules, transfers data, and repeats the tasks of lost workers. Tasks that a worker cannot
    compile go to others, if the executor can exclude it. If the iteration ends early, by an error or an interrupt,
    unfinished tasks are cancelled.

    Args:
        executor: executor of the workers; it is not shut down.
        work: a function at the top level of a module.
        tasks: its arguments. Threads of this process receive them directly, other workers in a `WorkerTask`.
        at_once: maximum number of submitted tasks, which bounds the memory here.

    Raises:
        WorkerError: workers were lost repeatedly, ran out of memory, have another version, or none can compile.
        DualwinchError: as raised by the work.
    """
    spreading = _Spreading(executor, work, tasks)
    try:
        spreading.submit(at_once)
        while spreading.stored or spreading.submitted:
            if finished := spreading.next():
                yield finished
                spreading.submit(1)
    except (CancelledError, BrokenExecutor, MemoryError) as error:
        raise WorkerError(f"workers: {_reason(error)}") from error
    except Exception as error:
        if isinstance(error, DualwinchError) or not type(error).__module__.startswith("distributed"):
            raise
        raise WorkerError(f"workers: {_reason(error)}") from error
    finally:
        for future in spreading.submitted:
            future.cancel()


Task: TypeAlias = tuple[int, tuple[Any, ...], str]
"""Number, arguments and key of a task; the key is empty without checkpoints."""


class _Spreading:
    """The tasks of a `spread`: those submitted to the executor, and those with stored results."""

    def __init__(self, executor: Executor, work: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> None:
        self.submitted = dict[Future[Any], Task]()
        self.stored = deque[Task]()
        self._checkpoints = executor if isinstance(executor, CheckpointingExecutor) else None
        self._executor = self._checkpoints.executor if self._checkpoints else executor
        self._work, self._tasks = work, enumerate(tasks)
        self._done = SimpleQueue[Future[Any]]()

    def submit(self, count: int) -> None:
        """Submit `count` further tasks to the executor, except those with stored results."""
        for number, arguments in islice(self._tasks, 1 if isinstance(self._executor, SerialExecutor) else count):
            key = ""
            if self._checkpoints:
                key = WorkerTask.of(self._work, *arguments).key(self._work, *arguments)
            if self._checkpoints and self._checkpoints.has(key):
                self.stored.append((number, arguments, key))
            else:
                self._send((number, arguments, key))

    def _send(self, task: Task) -> None:
        if isinstance(self._executor, ThreadPoolExecutor | SerialExecutor):
            future = self._executor.submit(self._work, *task[1])
        else:
            future = self._executor.submit(run_task, WorkerTask.of(self._work, *task[1]))
        self.submitted[future] = task
        future.add_done_callback(self._done.put)

    def next(self) -> tuple[int, Any] | None:
        """The next stored or computed result; None if its file is damaged or a worker cannot compile: sent again."""
        if self.stored and self._checkpoints:
            task = self.stored.popleft()
            for result in self._checkpoints.load(task[2]):
                return task[0], result
        else:
            future = self._done.get()
            task = self.submitted.pop(future)
            try:
                result = future.result()
            except WorkerCompileError as error:
                if not hasattr(self._executor, "exclude"):
                    raise
                self._executor.exclude(error)  # pyright: ignore[reportAttributeAccessIssue]
            else:
                if self._checkpoints:
                    self._checkpoints.store(task[2], result)
                return task[0], result
        self._send(task)
        return None


def _reason(error: BaseException) -> str:
    """Reason why workers did not compute a task, in one line."""
    if isinstance(error, MemoryError):
        return "a worker ran out of memory"
    if isinstance(error, CancelledError):
        return (
            "the scheduler has dropped a task: it was stopped or restarted, or lost the client; start scheduler "
            "and workers, and repeat the call"
        )
    if type(error).__name__ in {"KilledWorker", "BrokenProcessPool"}:
        return "every worker that started a task died: killed, or out of memory (see its log)"
    return one_line(f"{type(error).__name__}: {error}")


def in_order(numbered: Iterator[tuple[int, Returned]]) -> Iterator[Returned]:
    """Results of numbered tasks in the order of their numbers, each as soon as all before it are available."""
    results, count = dict[int, Returned](), 0
    for number, result in numbered:
        results[number] = result
        while count in results:
            yield results.pop(count)
            count += 1
