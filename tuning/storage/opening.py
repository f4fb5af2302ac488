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


def join_store(storage: str, study: str) -> "SharedJournalStudy | DatabaseStudy":
    """The storage of a study that another process has begun, in a shared file or in a database.

    Raises:
        ConfigurationError: there is no such study, or no other process may work on it.
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
    """The storage of a study that is begun, or gone on with.

    Args:
        storage: a file, or the URL of a database.
        study: the study's name.
        problem: gives objectives and space.
        definition: what is tuned, JSON-ready; kept with the study, and compared with what is there.
        budget: kept with the study, for workers to see.
        resume: whether a study of that name with trials may be gone on with.
        shared: whether other processes may work on a study in a file; on one in a database they always may.

    Raises:
        ConfigurationError: a study of that name has another definition, or trials and `resume` is false.
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
