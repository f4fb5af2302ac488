"""Open a study: in a journal file, or in a PostgreSQL database for workers on many machines."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.storage.connection import check_storage, is_database, quiet
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage

if TYPE_CHECKING:
    from dualwinch.tuning.storage.database import DatabaseStudy
    from dualwinch.tuning.storage.journal import SharedJournalStudy


def kept_definition(storage: str, study: str) -> Mapping[str, Any] | None:
    """The stored definition of a study in a file, or in the database of a URL; ``None`` if there is no such study.

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


def join_store(storage: str, study: str) -> "SharedJournalStudy | DatabaseStudy":
    """Open the storage of a study of another process, in a shared file or in a database.

    Raises:
        ConfigurationError: there is no such study, or it is not shared.
        DualwinchError: the storage cannot be used.
    """
    check_storage(storage)
    quiet()
    if is_database(storage):
        from dualwinch.tuning.storage.database import DatabaseStudy

        return DatabaseStudy.join(storage, study)
    from dualwinch.tuning.storage.journal import SharedJournalStudy

    return SharedJournalStudy.join(Path(storage), study)


def open_store(
    storage: str,
    study: str,
    problem: TuningProblem,
    definition: Mapping[str, Any],
    budget: SearchBudget,
    *,
    resume: bool,
    shared: bool = False,
) -> StudyStorage:
    """Open the storage of a new study, or of one to continue.

    Args:
        storage: a file, or the URL of a database.
        study: the study's name.
        problem: has objectives and space.
        definition: of the problem, for JSON; stored with a new study, and compared with that of an existing one.
        budget: stored with the study, for workers.
        resume: whether an existing study with trials may be continued.
        shared: whether other processes may join a study in a file; one in a database is always shared.

    Raises:
        ConfigurationError: a study of that name has another definition, or has trials and `resume` is false.
        DualwinchError: the storage cannot be used.
    """
    check_storage(storage)
    quiet()
    if is_database(storage):
        from dualwinch.tuning.storage.database import DatabaseStudy

        return DatabaseStudy.begin(storage, study, problem, definition, budget, resume=resume)
    from dualwinch.tuning.storage.journal import JournalStudy, SharedJournalStudy

    if shared:
        return SharedJournalStudy.begin(Path(storage), study, problem, definition, budget, resume=resume)
    return JournalStudy(Path(storage), study, problem, definition, budget, resume=resume)
