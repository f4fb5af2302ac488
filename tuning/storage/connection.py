"""Connections to a database: errors in one line that never show the password, and patience while it restarts."""

import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.errors import ConfigurationError

if TYPE_CHECKING:
    import optuna

Outcome = TypeVar("Outcome")

HEARTBEAT, GRACE = 5, 20
"""Time in s between two beats of a worker, and the silence after which it counts as dead."""

PATIENCE = 120.0
"""Time in s that a database may be away before a worker gives up."""


class StorageError(DualwinchError):
    """A study's storage cannot be reached or used."""


def shown(url: str) -> str:
    """A URL without its password."""
    from sqlalchemy.engine import make_url

    return make_url(url).render_as_string(hide_password=True)


def connected(url: str, stale: Callable[..., None]) -> "optuna.storages.RDBStorage":
    """Connect to a database, with Optuna's tables in it.

    Args:
        url: ``postgresql+psycopg://USER:PASSWORD@HOST/DATABASE``.
        stale: called with study and trial when a trial's worker has died.

    Raises:
        ConfigurationError: no URL.
        StorageError: it cannot be reached, or its tables are of another version of Optuna.
    """
    import optuna
    import sqlalchemy.exc

    from dualwinch.tuning.storage.tables import missing

    url = _driver(url)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            storage = optuna.storages.RDBStorage(
                url,
                skip_compatibility_check=True,
                engine_kwargs={"pool_pre_ping": True, "pool_size": 8, "connect_args": {"connect_timeout": 10}},
                heartbeat_interval=HEARTBEAT,
                grace_period=GRACE,
                heartbeat_stale_trial_callback=stale,
            )
    except sqlalchemy.exc.ArgumentError:
        raise ConfigurationError("--storage: no URL; must be postgresql+psycopg://USER@HOST/DATABASE") from None
    except (sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        raise StorageError(f"cannot use the database {shown(url)}: {_reason(error, url)}") from None
    there, here = storage.get_current_version(), storage.get_head_version()
    if there != here:
        storage.engine.dispose()
        raise StorageError(
            f"the database {shown(url)} is of another version of Optuna: its tables are {there}, must be {here}; "
            "use another database, or `optuna storage upgrade`"
        )
    if lacking := missing(storage.engine):
        storage.engine.dispose()
        raise StorageError(
            f"the database {shown(url)} is of a version of Optuna that is not known here: it lacks {', '.join(lacking)}"
        )
    return storage


def patient(url: str, action: Callable[[], Outcome]) -> Outcome:
    """Carry out an action on a database, again and again while the database is away.

    Raises:
        StorageError: it was away for longer than `PATIENCE`.
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


def _driver(url: str) -> str:
    """The URL with the driver that is installed."""
    return "postgresql+psycopg" + url.removeprefix("postgresql") if url.startswith("postgresql://") else url


def _reason(error: BaseException, url: str) -> str:
    """The innermost cause in one line, without the password."""
    from sqlalchemy.engine import make_url

    cause = error.__cause__ or error
    origin = getattr(cause, "orig", None) or cause
    lines = [line.strip() for line in str(origin).splitlines() if line.strip()]
    text = lines[0] if lines else type(origin).__name__
    password = make_url(url).password
    return text.replace(str(password), "***") if password else text
