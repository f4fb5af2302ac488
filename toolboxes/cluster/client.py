"""Work on the machines of a Dask cluster: its client, and an executor for every ``workers=`` argument.

Scheduling, retries and data transport are Dask's (https://distributed.dask.org), with its defaults unless its
configuration files or ``DASK_`` environment variables change them. The option ``--cluster`` finds `cluster_executor`
as the entry point ``cluster`` of the group ``dualwinch.executors``.
"""

import logging
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from dualwinch.toolbox import ConfigurationError, errors, executors, texts

if TYPE_CHECKING:
    from distributed import Client

Returned = TypeVar("Returned")


class ClusterExecutor(Executor):
    """The workers of a Dask cluster as an executor; tasks go to those that can compile.

    Args:
        client: connected to the cluster; it is not closed.
    """

    def __init__(self, client: "Client") -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        self._unable = dict[str, executors.WorkerCompileError]()

    def submit(self, fn: Callable[..., Returned], /, *args: Any, **kwargs: Any) -> Future[Returned]:
        """Compute a call on a worker.

        Raises:
            WorkerCompileError: no worker can compile.
        """
        return self._executor.submit(_on_worker, fn, *args, **kwargs, **self._able_workers())

    def exclude(self, error: executors.WorkerCompileError) -> None:
        """Exclude a worker that cannot compile, with one warning.

        Raises:
            WorkerCompileError: no worker can compile.
        """
        warned = error.worker in self._unable
        self._unable[error.worker] = error
        self._able_workers()
        if not warned:
            warnings.warn(f"{error}; its tasks go to other workers", executors.WorkerWarning, stacklevel=3)

    def _able_workers(self) -> dict[str, Any]:
        """Arguments with which Dask sends a task to workers that can compile, or to any worker once these have gone."""
        if not self._unable:
            return {}
        workers: Any = self._client.scheduler_info(n_workers=-1)["workers"]
        able = sorted(workers.keys() - self._unable.keys())
        if not able:
            raise next(reversed(self._unable.values()))
        return {"workers": able, "allow_other_workers": True}


def _on_worker(work: Callable[..., Returned], *arguments: Any, **options: Any) -> Returned:
    """Compute a call on a worker; the error of one that cannot compile has its address."""
    from distributed import get_worker

    try:
        return work(*arguments, **options)
    except executors.WorkerCompileError as error:
        error.worker = str(get_worker().address)
        raise


@contextmanager
def cluster_executor(where: str, say: Callable[[str], object]) -> Iterator[ClusterExecutor]:
    """Connect to a cluster, tell where it computes and where Dask's dashboard is, and yield its executor.

    Args:
        where: as in `cluster_client`, with the same errors.
        say: prints a line.
    """
    with cluster_client(where) as client:
        cluster: Any = client.scheduler_info(n_workers=-1)
        workers = cluster["workers"].values()
        threads = sum(worker["nthreads"] for worker in workers)
        size = f"{len(workers)} workers with {threads} threads" if workers else "no worker yet"
        say(f"cluster {cluster['address']}: {size}; dashboard {client.dashboard_link}")
        if not workers:
            say(f"waiting for workers; to start one: dask worker {cluster['address']}")
        yield ClusterExecutor(client)


SILENCED = (
    *(f"distributed.{name}" for name in ("client", "core", "batched", "utils", "comm")),
    "tornado.application",  # a future whose scheduler goes away while its result is passed on
)
"""Loggers of Dask that would write tracebacks of errors reported here in one line."""

ALLOWED = "must be the address of a Dask scheduler, tcp://HOST:8786, or FILE.py:FUNCTION that returns a Dask client"


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
        raise errors.MissingExtraError("Dask's distributed", "cluster") from None
    for name in SILENCED:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    file, _, function = where.rpartition(":")
    client: Any
    if "://" in where:
        _check_address(where)
        try:
            client = Client(where, set_as_default=False)
        except (OSError, ValueError) as error:
            why = texts.one_line(error)
            raise executors.WorkerError(
                f"{where}: no Dask scheduler answers ({why}); start `dask scheduler` there"
            ) from None
    elif file.endswith(".py") and function.isidentifier():
        client = _returned_by(Path(file), function, where)
        if not isinstance(client, Client):
            raise ConfigurationError(f"{where}: returned {type(client).__name__}; must return a distributed.Client")
        if client.status != "running":
            raise executors.WorkerError(
                f"{where}: returned a client that is {client.status}; must be one that is connected"
            )
    else:
        raise ConfigurationError(f"{where}: {ALLOWED}")
    try:
        yield client
    finally:
        cluster = client.cluster
        client.close()
        if cluster is not None:
            cluster.close()


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
        raise ConfigurationError(f"{where}: {texts.one_line(error)}; {ALLOWED}") from None
    if scheme in {"tls", "wss"} and not Security().get_connection_args("client").get("ssl_context"):
        raise ConfigurationError(
            f"{where}: needs certificates, from Dask's configuration (distributed.comm.tls), or from a client with "
            "Security that FILE.py:FUNCTION returns"
        )


def _returned_by(file: Path, function: str, where: str) -> Any:
    """Call a function of a file."""
    if not file.is_file():
        raise ConfigurationError(f"{where}: there is no file {file}; {ALLOWED}")
    spec = spec_from_file_location(f"_cluster_of_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise ConfigurationError(f"{where}: {ALLOWED}")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        make = getattr(module, function, None)
        client = make() if make else None
    except (Exception, SystemExit) as error:
        raise executors.WorkerError(f"{where}: {type(error).__name__}: {texts.one_line(error)}") from error
    if make is None:
        raise ConfigurationError(f"{where}: {file.name} has no function {function}")
    return client
