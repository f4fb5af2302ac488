"""Open a study: in a journal file of one process, or in a database that processes and machines share."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.storage.connection import check_storage, is_database, quiet
from dualwinch.tuning.storage.store import StudyStorage


def stored_definition(storage: str, study: str) -> Mapping[str, Any] | None:
    """The stored definition of a study in a file, or in the database of a URL; ``None`` if there is no such file.

    Raises:
        ConfigurationError: there is no such study, or the file is no journal.
        DualwinchError: the storage cannot be used.
    """
    check_storage(storage)
    quiet()
    from dualwinch.tuning.storage.connection import connected
    from dualwinch.tuning.storage.journal import journal_storage, locked, mend
    from dualwinch.tuning.storage.optuna_study import definition_in

    if is_database(storage):
        database = connected(storage)
        try:
            return definition_in(database, study)
        finally:
            database.engine.dispose()
    path = Path(storage)
    if not path.is_file():
        return None
    with locked(path):
        mend(path)
        return definition_in(journal_storage(path), study)


def open_store(
    storage: str, study: str, problem: TuningProblem, definition: Mapping[str, Any], *, resume: bool
) -> StudyStorage:
    """Open the storage of a new study, of one to continue, or of one to join.

    Args:
        storage: a file, or the URL of a database.
        study: the study's name.
        problem: has objectives and space.
        definition: of the problem, for JSON; stored with a new study, and compared with that of an existing one.
        resume: whether the study's trials count in the budget. A study in a file can only be continued in this way; one
            in a database is joined otherwise.

    Raises:
        ConfigurationError: a study of that name has another definition; or a file has trials and `resume` is false.
        DualwinchError: the storage cannot be used.
    """
    check_storage(storage)
    quiet()
    from dualwinch.tuning.storage.optuna_study import DatabaseStudy, JournalStudy

    if is_database(storage):
        return DatabaseStudy(storage, study, problem, definition, resume=resume)
    return JournalStudy(Path(storage), study, problem, definition, resume=resume)
