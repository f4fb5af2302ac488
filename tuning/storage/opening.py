"""Open a study: in a journal file for one process, or in a PostgreSQL database for workers on many machines."""

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage


def quiet() -> None:
    """Let Optuna speak of problems only, not of every study and trial, nor of progress bars it does not show."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)


def is_database(storage: str) -> bool:
    """Whether a storage is a database and not a file."""
    return "://" in storage


def check_storage(storage: str) -> None:
    """Find out whether a storage can be one.

    Raises:
        ConfigurationError: a database that is none of PostgreSQL's, or a library that is missing.
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
        raise ConfigurationError("--storage: PostgreSQL needs psycopg, `pip install 'dualwinch[postgresql]'`")
    from dualwinch.tuning.storage.connection import check_url

    check_url(storage)


def kept_definition(storage: str, study: str) -> Mapping[str, Any] | None:
    """What a study was begun with; ``None`` where there is no such study.

    Args:
        storage: a file, or the URL of a database.
        study: the study's name.

    Raises:
        ConfigurationError: the file is no journal.
        DualwinchError: the storage cannot be used.
    """
    check_storage(storage)
    quiet()
    if is_database(storage):
        from dualwinch.tuning.storage.database import definition_in_database

        return definition_in_database(storage, study)
    from dualwinch.tuning.storage.journal import definition_in_journal

    return definition_in_journal(Path(storage), study)


def open_store(
    storage: str,
    study: str,
    problem: TuningProblem,
    definition: Mapping[str, Any],
    budget: SearchBudget,
    *,
    resume: bool,
) -> StudyStorage:
    """The storage of a study that is begun, or gone on with.

    Args:
        storage: a file, or the URL of a database.
        study: the study's name.
        problem: gives objectives and space.
        definition: what is tuned, JSON-ready; kept with the study, and compared with what is there.
        budget: kept with the study, for workers to see.
        resume: whether a study of that name with trials may be gone on with.

    Raises:
        ConfigurationError: a study of that name has another definition, or trials and `resume` is false.
        DualwinchError: the storage cannot be used.
    """
    check_storage(storage)
    quiet()
    if is_database(storage):
        from dualwinch.tuning.storage.database import DatabaseStudy

        return DatabaseStudy.begin(storage, study, problem, definition, budget, resume=resume)
    from dualwinch.tuning.storage.journal import JournalStudy

    return JournalStudy(Path(storage), study, problem, definition, budget, resume=resume)
