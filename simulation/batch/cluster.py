"""A Dask cluster whose workers compute what is many runs: by its scheduler's address, or by a function of your own.

Scheduling, retries and the transport of data are Dask's (https://distributed.dask.org); its defaults stand, and its
configuration files and ``DASK_`` environment variables change them.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dualwinch.codegen.text import one_line
from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.simulation.batch.task import WorkerError

if TYPE_CHECKING:
    from distributed import Client

QUIET = ("distributed.client", "distributed.core", "distributed.batched", "distributed.utils", "distributed.comm")
"""Loggers of Dask that write, with tracebacks, what becomes a line here."""

WANTED = "must be the address of a Dask scheduler, tcp://HOST:8786, or FILE.py:FUNCTION that returns a Dask client"


@contextmanager
def cluster_client(where: str) -> Iterator["Client"]:
    """Connect to a cluster; at the end the connection is closed, and a cluster that the function has started, too.

    Args:
        where: address of a scheduler, such as ``tcp://host:8786``; or ``FILE.py:FUNCTION``, a function without
            arguments that returns a `distributed.Client`.

    Raises:
        ConfigurationError: neither.
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
        client = _made(Path(file), function, where)
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
    """Raise `ConfigurationError` where an address cannot be one of a scheduler: a client would wait for a minute."""
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


def _made(file: Path, function: str, where: str) -> Any:
    """What a function of a file returns."""
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
