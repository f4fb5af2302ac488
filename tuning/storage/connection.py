"""Connections to a database, with one-line errors that never show the password, and retries while it restarts."""

import re
import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar
from urllib.parse import quote, quote_plus

from dualwinch.codegen.errors import DualwinchError, installing
from dualwinch.codegen.text import one_line, without_secrets
from dualwinch.model.errors import ConfigurationError

if TYPE_CHECKING:
    import optuna
    from sqlalchemy.engine import URL

Returned = TypeVar("Returned")

HEARTBEAT, GRACE = 5, 20
"""Heartbeat interval of a worker in s, and the time in s without heartbeat after which it counts as dead."""

HARMLESS = {"host", "hostaddr", "port", "user", "dbname", "sslmode", "application_name", "connect_timeout", "service"}
"""Parameters of a URL's query that are not secret."""

PATIENCE = 120.0
"""Time in s for which a worker retries while the database is unavailable."""


class StorageError(DualwinchError):
    """A study's storage cannot be reached or used."""


WANTED = "postgresql+psycopg://USER@HOST/DATABASE"
"""Format of a URL."""


def shown(url: str) -> str:
    """A database's URL without possible secrets: no password and no query."""
    parts = _parts(url)
    if parts is None:
        return "(no URL)"
    user = f"{parts.username}:***@" if parts.password else f"{parts.username}@" if parts.username else ""
    port = f":{parts.port}" if parts.port else ""
    name = "***" if re.search(r"=|://", parts.database or "") else parts.database or ""
    query = "?***" if parts.query else ""
    return one_line(f"{parts.drivername}://{user}{parts.host or ''}{port}/{name}{query}")


def check_url(url: str) -> None:
    """Raise `ConfigurationError` for an invalid URL; the message shows no part of it."""
    if _parts(url) is None:
        raise ConfigurationError(
            f"--storage: not the URL of a database; must be {WANTED}, with a number as port, and with special "
            "characters of a password such as @, : and / written as %40, %3A and %2F"
        )


def _parts(url: str) -> "URL | None":
    """The parts of a URL; ``None`` if it is invalid, or if its host would contain an @."""
    import sqlalchemy.exc
    from sqlalchemy.engine import make_url

    try:
        parts = make_url(url)
    except (sqlalchemy.exc.ArgumentError, ValueError):
        return None
    return None if re.search(r"[@\s]", parts.host or "") else parts


def connected(url: str) -> "optuna.storages.RDBStorage":
    """Connect to a database with Optuna's tables.

    Args:
        url: ``postgresql+psycopg://USER:PASSWORD@HOST/DATABASE``.

    Raises:
        ConfigurationError: an invalid URL.
        StorageError: it cannot be reached, or its tables are of another version of Optuna.
    """
    import optuna
    import sqlalchemy.exc

    check_url(url)
    if url.startswith("postgresql://"):
        url = url.replace("postgresql", "postgresql+psycopg", 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            storage = optuna.storages.RDBStorage(
                url,
                skip_compatibility_check=True,
                engine_kwargs={"pool_pre_ping": True, "pool_size": 8, "connect_args": {"connect_timeout": 10}},
                heartbeat_interval=HEARTBEAT,
                grace_period=GRACE,
                heartbeat_stale_trial_callback=optuna.storages.RetryHeartbeatStaleTrialCallback(),
            )
    except (sqlalchemy.exc.ArgumentError, ValueError):
        raise ConfigurationError(f"--storage: not the URL of a database; must be {WANTED}") from None
    except (sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        raise StorageError(f"cannot use the database {shown(url)}: {_reason(error, url)}") from None
    there, here = storage.get_current_version(), storage.get_head_version()
    if there != here:
        storage.engine.dispose()
        raise StorageError(
            f"the database {shown(url)} is of another version of Optuna: its tables are {there}, must be {here}; "
            "use another database, or `optuna storage upgrade`"
        )
    return storage


def patient(url: str, action: Callable[[], Returned]) -> Returned:
    """Carry out an action on a database, with retries while it is unavailable.

    Raises:
        StorageError: it was unavailable for longer than `PATIENCE`.
    """
    import optuna
    import sqlalchemy.exc

    deadline, pause = time.monotonic() + PATIENCE, 0.2
    while True:
        try:
            return action()
        except (sqlalchemy.exc.DBAPIError, optuna.exceptions.StorageInternalError) as error:
            if time.monotonic() + pause > deadline:
                raise StorageError(f"the database {shown(url)} is gone: {_reason(error, url)}") from None
            time.sleep(pause)
            pause = min(2 * pause, 5.0)


def _reason(error: BaseException, url: str) -> str:
    """The innermost cause in one line, without the password."""
    cause = error.__cause__ or error
    origin = getattr(cause, "orig", None) or cause
    lines = [line.strip() for line in str(origin).splitlines() if line.strip()]
    text = lines[0] if lines else type(origin).__name__
    for secret in sorted(_secrets(url), key=len, reverse=True):
        text = text.replace(secret, "***")
    return without_secrets(one_line(text))


def _secrets(url: str) -> set[str]:
    """Secrets in a URL, as written there and decoded."""
    parts = _parts(url)
    if parts is None:
        return {url}
    found = {str(parts.password)} if parts.password else set()
    for name, value in parts.query.items():
        if name not in HARMLESS:
            found |= {value} if isinstance(value, str) else set(value)
    if re.search(r"=|://", parts.database or ""):
        found.add(str(parts.database))
    return {secret for plain in found for secret in (plain, quote(plain, safe=""), quote_plus(plain)) if secret}


def quiet() -> None:
    """Limit Optuna's messages to problems."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)


def is_database(storage: str) -> bool:
    """Whether a storage is a database, not a file."""
    return "://" in storage


def check_storage(storage: str) -> None:
    """Check the name of a storage.

    Raises:
        ConfigurationError: a database other than PostgreSQL, or a missing library.
    """
    if not is_database(storage):
        if re.match(r"postgres[\w+]*:", storage, re.IGNORECASE) or re.search(r"passw\w*\s*=", storage, re.IGNORECASE):
            raise ConfigurationError("--storage: must be a file, or postgresql+psycopg://USER@HOST/DATABASE")
        return
    kind = storage.partition("://")[0]
    if kind not in {"postgresql+psycopg", "postgresql"}:
        begun = f" {kind}://..." if re.fullmatch(r"[\w+.-]{1,40}", kind) else ""
        raise ConfigurationError(f"--storage{begun}: must be a file, or postgresql+psycopg://USER@HOST/DATABASE")
    import importlib.util

    if importlib.util.find_spec("psycopg") is None:
        raise ConfigurationError(f"--storage: PostgreSQL needs psycopg; install it with: {installing('postgresql')}")
    check_url(storage)
