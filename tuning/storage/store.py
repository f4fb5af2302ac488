"""Where a study is kept: a journal file for one process, or a PostgreSQL database for workers on many machines."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.space import Space

DEFINITION, BUDGET, OBJECTIVES = "dualwinch definition", "dualwinch budget", "objectives"
"""User attributes of a study: what is tuned, how far, and what the values of a trial are."""

Propose = Callable[[int, bool], list[Candidate]]
"""``propose(count, first)``: candidates; `first` where the study has no trial yet."""


@dataclass(frozen=True)
class Claim:
    """A candidate that is this process's to evaluate.

    Attributes:
        candidate: what to evaluate.
        trial: its id in the storage; 0 where it appears there only when it is finished.
    """

    candidate: Candidate
    trial: int = 0


@dataclass(frozen=True)
class Budget:
    """When a study is over.

    Attributes:
        trials: number of finished trials; ``None``: no limit.
        until: time in s since the epoch; ``None``: no limit.
    """

    trials: int | None = None
    until: float | None = None


class Store(Protocol):
    """A study's storage, as one process sees it."""

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        ...

    def claim(self, count: int, budget: Budget, propose: Propose) -> list[Claim]:
        """Take candidates, none where the budget's trials are all finished or under way."""
        ...

    def finish(self, claims: Sequence[Claim], evaluations: Sequence[Evaluation]) -> None:
        """Keep what candidates came to."""
        ...

    def release(self, claims: Sequence[Claim]) -> None:
        """Give candidates back that will not be evaluated here."""
        ...

    def news(self) -> list[Evaluation]:
        """What other processes have finished since the last call."""
        ...

    def budget(self) -> Budget:
        """The study's budget as it stands."""
        ...

    def set_budget(self, budget: Budget) -> None:
        """Change the study's budget, for all processes."""
        ...

    def count(self) -> int:
        """Number of finished trials."""
        ...

    def complete(self, budget: Budget) -> bool:
        """Whether as many trials are finished as there shall be."""
        ...

    def close(self) -> None:
        """Let go of files and connections."""
        ...


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
        return
    kind = storage.partition("://")[0]
    if kind not in {"postgresql+psycopg", "postgresql"}:
        raise ConfigurationError(f"--storage {kind}://...: must be a file, or postgresql+psycopg://USER@HOST/DATABASE")
    import importlib.util

    if importlib.util.find_spec("psycopg") is None:
        raise ConfigurationError("--storage: PostgreSQL needs psycopg, `pip install 'dualwinch[postgresql]'`")


def open_store(
    storage: str, study: str, problem: Problem, definition: Mapping[str, Any], budget: Budget, *, resume: bool
) -> Store:
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
        from dualwinch.tuning.storage.database import Database

        return Database.begin(storage, study, problem, definition, budget, resume=resume)
    from dualwinch.tuning.storage.journal import Journal

    return Journal(Path(storage), study, problem, definition, budget, resume=resume)


def check_definition(
    study: str, ours: Mapping[str, Any], theirs: Mapping[str, Any] | None, spaces: tuple[Space, Space]
) -> None:
    """Refuse to mix two problems in one study.

    Args:
        study: the study's name.
        ours: the definition asked for.
        theirs: the definition in the storage; ``None``: it is not a study of this program.
        spaces: both spaces.

    Raises:
        ConfigurationError: they differ; the message says in what.
    """
    if theirs is None:
        raise ConfigurationError(f"--study {study}: exists, and is none of this program; choose another name")
    difference = spaces[0].difference(spaces[1])
    if difference:
        raise ConfigurationError(f"--study {study}: has another space: {difference}; choose another name")
    for key, value in ours.items():
        if key != "space" and value != theirs.get(key):
            shown = f": {value!r} here, {theirs.get(key)!r} there" if len(repr(value)) < 100 else ""
            raise ConfigurationError(f"--study {study}: was begun with another {key}{shown}; choose another name")


def check_resume(study: str, count: int, *, resume: bool) -> None:
    """Refuse to go on with a study by accident.

    Raises:
        ConfigurationError: there are trials and nobody asked to go on.
    """
    if count and not resume:
        raise ConfigurationError(f"--study {study}: has {count} trials; go on with --resume, or choose another name")
