"""Compute many runs on threads of this machine, or on the workers of an executor, such as a Dask cluster.

Every ``workers=`` argument accepts a number of threads (compiled code runs without Python's lock) or a
`concurrent.futures.Executor`, such as a ``ProcessPoolExecutor`` or Dask's ``client.get_executor()``. The runs are then
split into portions that do not depend on the number of workers, and results are assembled by portion number, so that
they are the same bits for any number of workers and any order. A `CheckpointingExecutor` stores finished portions, so
that interrupted work can be resumed by calling it again.

`cluster_client` connects to a Dask cluster, by the address of its scheduler or by a function of your own. Scheduling,
retries and data transport are Dask's (https://distributed.dask.org), with its defaults unless its configuration files
or ``DASK_`` environment variables change them.
"""

import logging
import os
import pickle
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from contextvars import copy_context
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar
from weakref import WeakKeyDictionary

from dualwinch.codegen.errors import DualwinchError
from dualwinch.codegen.files import atomic
from dualwinch.codegen.text import one_line
from dualwinch.model.arguments import whole_number
from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.simulation.batch.task import WorkerCompileError, WorkerError, WorkerTask, run_task
from dualwinch.simulation.progress import Progress, no_progress

if TYPE_CHECKING:
    from distributed import Client


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
        for done, future in enumerate(as_completed(futures), 1):
            future.result()
            progress(done / len(jobs))
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
    found: dict[int, Returned] = {}

    def one(index: int) -> None:
        found[index] = work(items[index])

    if not run_all([partial(one, index) for index in range(len(items))], threads):
        raise KeyboardInterrupt
    return [found[index] for index in range(len(items))]


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

    def find(self, key: str) -> tuple[Any] | None:
        """The stored result of a task; None if there is none or it cannot be read."""
        try:
            return (pickle.loads(self._file(key).read_bytes()),)  # noqa: S301  the user's own folder
        except Exception:  # noqa: BLE001  damaged in any way: computed anew
            return None

    def keep(self, key: str, result: object) -> None:
        """Store the result of a task; its file appears whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        with atomic(self._file(key)) as unfinished:
            unfinished.write_bytes(pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL))

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}.result"


UNABLE: WeakKeyDictionary[Executor, dict[str, WorkerCompileError]] = WeakKeyDictionary()
"""Executor → address of each worker that cannot compile → its error."""


def spread(
    executor: Executor,
    work: Callable[..., Returned],
    tasks: Iterable[tuple[Any, ...]],
    *,
    at_once: int = 4096,
) -> Generator[tuple[int, Returned], None, None]:
    """Compute tasks on an executor's workers; yield task numbers and results in the order in which they finish.

    The executor schedules, transfers data, and repeats the tasks of lost workers. Tasks that a Dask worker cannot
    compile go to others. If the iteration ends early, by an error or an interrupt, unfinished tasks are cancelled.

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
        while spreading.kept or spreading.waiting:
            found = spreading.next()
            if found is not None:
                yield found
                spreading.submit(1)
    except (CancelledError, BrokenExecutor, MemoryError) as error:
        raise WorkerError(f"workers: {_reason(error)}") from error
    except Exception as error:
        if isinstance(error, DualwinchError) or not type(error).__module__.startswith("distributed"):
            raise
        raise WorkerError(f"workers: {_reason(error)}") from error
    finally:
        for future in spreading.waiting:
            future.cancel()


class _Spreading:
    """The tasks of a `spread`: those submitted to the executor, and those with stored results."""

    def __init__(self, executor: Executor, work: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> None:
        self.waiting = dict[Future[Any], tuple[int, tuple[Any, ...], str]]()
        self.kept = deque[tuple[int, tuple[Any, ...], str]]()
        self._keeping = executor if isinstance(executor, CheckpointingExecutor) else None
        self._executor = self._keeping.executor if self._keeping else executor
        self._work, self._numbered = work, enumerate(tasks)
        self._done = SimpleQueue[Future[Any]]()

    def submit(self, count: int) -> None:
        """Submit `count` further tasks to the executor, except those with stored results."""
        for number, arguments in islice(self._numbered, count):
            key = ""
            if self._keeping:
                key = WorkerTask.of(self._work, *arguments).key(self._work, *arguments)
                if self._keeping.has(key):
                    self.kept.append((number, arguments, key))
                    continue
            self._send(number, arguments, key)

    def _send(self, number: int, arguments: tuple[Any, ...], key: str) -> None:
        if isinstance(self._executor, ThreadPoolExecutor):
            future = self._executor.submit(self._work, *arguments)
        else:
            task = WorkerTask.of(self._work, *arguments)
            future = self._executor.submit(run_task, task, **_allowed_workers(self._executor))
        self.waiting[future] = number, arguments, key
        future.add_done_callback(self._done.put)

    def next(self) -> tuple[int, Any] | None:
        """The next stored or computed result; None if its file is damaged or a worker cannot compile: sent again."""
        if self.kept:
            number, arguments, key = self.kept.popleft()
            found = self._keeping.find(key) if self._keeping else None
            if found:
                return number, found[0]
        else:
            future = self._done.get()
            number, arguments, key = self.waiting.pop(future)
            try:
                result = future.result()
            except WorkerCompileError as error:
                _exclude(self._executor, error)
            else:
                if self._keeping:
                    self._keeping.keep(key, result)
                return number, result
        self._send(number, arguments, key)
        return None


def _exclude(executor: Executor, error: WorkerCompileError) -> None:
    """Exclude a worker that cannot compile, with one warning.

    Raises:
        WorkerCompileError: no worker can compile, or it is not a Dask worker and so cannot be excluded.
    """
    if not error.worker:
        raise error
    unable = UNABLE.setdefault(executor, {})
    known, unable[error.worker] = error.worker in unable, error
    if _allowed_workers(executor) and not known:
        warnings.warn(f"{error}; its tasks go to other workers", WorkerWarning, stacklevel=3)


def _allowed_workers(executor: Executor) -> dict[str, Any]:
    """Arguments with which Dask sends a task to workers that can compile, or to any worker once these have gone.

    Raises:
        WorkerCompileError: no worker can compile.
    """
    unable = UNABLE.get(executor)
    if not unable:
        return {}
    able = sorted(vars(executor)["_client"].scheduler_info(n_workers=-1)["workers"].keys() - unable.keys())
    if not able:
        raise next(reversed(unable.values()))
    return {"workers": able, "allow_other_workers": True}


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
    early, following = dict[int, Returned](), 0
    for number, result in numbered:
        early[number] = result
        while following in early:
            yield early.pop(following)
            following += 1


QUIET = (
    *(f"distributed.{name}" for name in ("client", "core", "batched", "utils", "comm")),
    "tornado.application",  # a future whose scheduler goes away while its result is passed on
)
"""Loggers of Dask that would write tracebacks of errors reported here in one line."""

WANTED = "must be the address of a Dask scheduler, tcp://HOST:8786, or FILE.py:FUNCTION that returns a Dask client"


@contextmanager
def cluster_client(where: str) -> Iterator["Client"]:
    """Connect to a cluster; at the end, close the connection, and the cluster if the function has started it.

    Args:
        where: address of a scheduler, such as ``tcp://host:8786``; or ``FILE.py:FUNCTION``, a function without
            arguments that returns a `distributed.Client`.

    Raises:
        ConfigurationError: `where` is neither.
        MissingExtraError: Dask is not installed.
        WorkerError: the scheduler cannot be reached, or the function fails.
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("Dask's distributed", "cluster") from None
    for name in QUIET:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    file, _, function = where.rpartition(":")
    client: Any
    if "://" in where:
        _check_address(where)
        try:
            client = Client(where, set_as_default=False)
        except (OSError, ValueError) as error:
            why = one_line(error)
            raise WorkerError(f"{where}: no Dask scheduler answers ({why}); start `dask scheduler` there") from None
    elif file.endswith(".py") and function.isidentifier():
        client = _returned_by(Path(file), function, where)
        if not isinstance(client, Client):
            raise ConfigurationError(f"{where}: returned {type(client).__name__}; must return a distributed.Client")
        if client.status != "running":
            raise WorkerError(f"{where}: returned a client that is {client.status}; must be one that is connected")
    else:
        raise ConfigurationError(f"{where}: {WANTED}")
    try:
        yield client
    finally:
        own = client.cluster
        client.close()
        if own is not None:
            own.close()


def _check_address(where: str) -> None:
    """Raise `ConfigurationError` for an invalid scheduler address, with which a client would wait for a minute."""
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import get_backend
    from distributed.security import Security

    try:
        scheme, place = parse_address(where)
        get_backend(scheme)
        parse_host_port(place)
    except ValueError as error:
        raise ConfigurationError(f"{where}: {one_line(error)}; {WANTED}") from None
    if scheme in {"tls", "wss"} and not Security().get_connection_args("client").get("ssl_context"):
        raise ConfigurationError(
            f"{where}: needs certificates, from Dask's configuration (distributed.comm.tls), or from a client with "
            "Security that FILE.py:FUNCTION returns"
        )


def _returned_by(file: Path, function: str, where: str) -> Any:
    """Call a function of a file."""
    if not file.is_file():
        raise ConfigurationError(f"{where}: there is no file {file}; {WANTED}")
    spec = spec_from_file_location(f"_cluster_of_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise ConfigurationError(f"{where}: {WANTED}")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        make = getattr(module, function, None)
        found = make() if make else None
    except (Exception, SystemExit) as error:
        raise WorkerError(f"{where}: {type(error).__name__}: {one_line(error)}") from error
    if make is None:
        raise ConfigurationError(f"{where}: {file.name} has no function {function}")
    return found
