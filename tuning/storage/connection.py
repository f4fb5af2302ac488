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

HARMLESS = {"host", "hostaddr", "port", "user", "dbname", "sslmode", "application_name", "connect_timeout", "service"}
"""Parameters of a URL's query that are not secret."""

PATIENCE = 120.0
"""Time in s for which a process retries while the database is unavailable."""


class StorageError(DualwinchError):
    """A study's storage cannot be reached or used."""


EXAMPLE = "postgresql+psycopg://USER@HOST/DATABASE"
"""A URL in errors, which never show one that was given."""


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


def checked_url(url: str) -> "URL":
    """Parse a URL; raise `ConfigurationError` if it is invalid, with a message that shows no part of it."""
    if (parts := _parts(url)) is None:
        raise ConfigurationError(
            f"--storage: not the URL of a database; must be such as {EXAMPLE}, with a number as port, and with special "
            "characters of a password such as @, : and / written as %40, %3A and %2F"
        )
    return parts


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
        url: of SQLAlchemy, such as ``postgresql+psycopg://USER:PASSWORD@HOST/DATABASE``.

    Raises:
        ConfigurationError: an invalid URL.
        StorageError: it cannot be reached, or its tables are of another version of Optuna.
    """
    import optuna
    import sqlalchemy.exc

    checked_url(url)
    timeout = {"connect_args": {"connect_timeout": 10}} if url.startswith(POSTGRESQL) else {}
    try:
        storage = optuna.storages.RDBStorage(
            with_driver(url), skip_compatibility_check=True, engine_kwargs={"pool_pre_ping": True, **timeout}
        )
    except (sqlalchemy.exc.ArgumentError, ValueError):
        raise ConfigurationError(f"--storage: not the URL of a database; must be such as {EXAMPLE}") from None
    except (sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        raise StorageError(f"cannot use the database {shown(url)}: {_reason(error, url)}") from None
    version, supported = storage.get_current_version(), storage.get_head_version()
    if version != supported:
        storage.engine.dispose()
        raise StorageError(
            f"the database {shown(url)} is of another version of Optuna: its tables are {version}, must be "
            f"{supported}; use another database, or `optuna storage upgrade`"
        )
    return storage


POSTGRESQL = "postgresql"
"""Beginning of the URLs of PostgreSQL."""


def with_driver(url: str) -> str:
    """A URL with psycopg as the driver of PostgreSQL, where it names none."""
    return re.sub(f"^{POSTGRESQL}://", f"{POSTGRESQL}+psycopg://", url)


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
    secrets = {str(parts.password)} if parts.password else set()
    for name, value in parts.query.items():
        if name not in HARMLESS:
            secrets |= {value} if isinstance(value, str) else set(value)
    if re.search(r"=|://", parts.database or ""):
        secrets.add(str(parts.database))
    return {secret for text in secrets for secret in (text, quote(text, safe=""), quote_plus(text)) if secret}


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
        ConfigurationError: an invalid URL, or a database whose driver is not installed.
    """
    if not is_database(storage):
        if re.match(r"postgres[\w+]*:", storage, re.IGNORECASE) or re.search(r"passw\w*\s*=", storage, re.IGNORECASE):
            raise ConfigurationError(f"--storage: must be a file, or the URL of a database such as {EXAMPLE}")
        return
    import sqlalchemy.exc

    url = checked_url(with_driver(storage))
    try:
        url.get_dialect().import_dbapi()
    except sqlalchemy.exc.ArgumentError:
        raise ConfigurationError(f"--storage: no database that SQLAlchemy knows; must be such as {EXAMPLE}") from None
    except ImportError as error:
        hint = f"; install it with: {installing(POSTGRESQL)}" if storage.startswith(POSTGRESQL) else ""
        raise ConfigurationError(f"--storage: the driver of the database is missing ({error.name}){hint}") from None
