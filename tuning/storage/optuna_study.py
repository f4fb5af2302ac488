"""A study in an Optuna storage: a journal file of one process, or a database in which processes and machines join in.

Only finished trials are stored, each in one transaction with all that is known of it. A process that is killed loses
the batch that it evaluates, and nothing else; nobody waits for it. Every process has a budget of its own, learns from
the trials of the others after each batch, and selects the best of all that are there at the end of its search.
"""

import os
import secrets
import socket
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, TypeVar

import optuna
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, TrialState

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import another, unknown
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.space import Space, space_from
from dualwinch.tuning.storage.connection import connected, patient
from dualwinch.tuning.storage.journal import journal_storage, locked, mend, uninterrupted
from dualwinch.tuning.storage.parts import StudyName, check_parts
from dualwinch.tuning.storage.record import STREAM, evaluation_of, finished_trial
from dualwinch.tuning.storage.store import StudyStorage

Returned = TypeVar("Returned")

FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)
"""States of finished trials."""

DEFINITION, OBJECTIVES = "dualwinch definition", "objectives"
"""User attributes of a study: its definition, and names of the values of a trial, with units."""


class OptunaStudy(StudyStorage):
    """A study's trials in an Optuna storage.

    Attributes:
        continued: whether trials that were there before count in the budget of this process's search.
    """

    def __init__(self, study: optuna.Study, space: Space, *, continued: bool) -> None:
        self.continued = continued
        self._study, self._space = study, space
        self._reported = set[int]()
        self._stream = super().stream

    @property
    def stream(self) -> str:
        """Name of the random stream of this process's search; also that of its trials in the storage."""
        return self._stream

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers; `news` does not repeat them."""
        return self._reporting(self._trials())

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials())

    def _trials(self) -> list[FrozenTrial]:
        return self._study.get_trials(deepcopy=False, states=FINISHED)

    def _reporting(self, trials: Sequence[FrozenTrial]) -> list[Evaluation]:
        self._reported.update(trial.number for trial in trials)
        return [evaluation_of(trial) for trial in trials]

    def _frozen(self, evaluations: Sequence[Evaluation]) -> list[FrozenTrial]:
        return [finished_trial(evaluation, self._space, self.stream) for evaluation in evaluations]


class JournalStudy(OptunaStudy):
    """A study in a journal file, which this process alone may use."""

    def __init__(
        self, path: Path, name: str, problem: TuningProblem, definition: Mapping[str, Any], *, resume: bool
    ) -> None:
        """Open or create the file; arguments and errors as in `open_store`."""
        self._lock: IO[bytes] = locked(path)
        try:
            mend(path)
            study, _ = _loaded(StudyName(name, path), journal_storage(path), problem, definition)
            super().__init__(study, problem.space, continued=True)
            if not resume:
                self._check_empty(StudyName(name, path))
        except BaseException:
            self._lock.close()
            raise

    def _check_empty(self, name: StudyName) -> None:
        if count := self.count():
            raise ConfigurationError(f"{name} has {count} trials; continue with --resume, or {name.another}")

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Write finished trials; an interrupt is deferred until all are written."""
        with uninterrupted():
            self._study.add_trials(self._frozen(evaluations))

    def close(self) -> None:
        """Unlock and close the file."""
        self._lock.close()


class DatabaseStudy(OptunaStudy):
    """A study in a database, which any number of processes on any machines search at the same time."""

    def __init__(
        self, url: str, name: str, problem: TuningProblem, definition: Mapping[str, Any], *, resume: bool
    ) -> None:
        """Connect to the database, and join the study or create it; arguments and errors as in `open_store`."""
        self._url, self._storage = url, connected(url)
        try:
            study, new = self._attempt(lambda: _loaded(StudyName(name), self._storage, problem, definition))
            super().__init__(study, problem.space, continued=resume)
        except BaseException:
            self._storage.engine.dispose()
            raise
        if not new:  # others may search from the same number of trials
            self._stream += f", {socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"

    def _attempt(self, action: Callable[[], Returned]) -> Returned:
        return patient(self._url, action)

    def _trials(self) -> list[FrozenTrial]:
        return self._attempt(super()._trials)

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Write finished trials, one transaction each."""
        for trial in self._frozen(evaluations):
            self._attempt(lambda trial=trial: self._study.add_trial(trial))

    def news(self) -> list[Evaluation]:
        """Trials finished by other processes since the last call."""
        return self._reporting(
            [
                trial
                for trial in self._trials()
                if trial.number not in self._reported and trial.user_attrs.get(STREAM) != self.stream
            ]
        )

    def close(self) -> None:
        """End the connections."""
        self._storage.engine.dispose()


def _loaded(
    name: StudyName, storage: optuna.storages.BaseStorage, problem: TuningProblem, definition: Mapping[str, Any]
) -> tuple[optuna.Study, bool]:
    """Load a study, or create it if it does not exist; return it, and whether it is new.

    The definition is written last: a study without one, because its process was killed, is completed.

    Raises:
        ConfigurationError: the study has another definition.
    """
    directions = [StudyDirection.MINIMIZE] * len(problem.objectives)
    new = True
    try:
        study = optuna.create_study(study_name=name.study, storage=storage, directions=directions)
    except optuna.exceptions.DuplicatedStudyError:
        study = optuna.load_study(study_name=name.study, storage=storage)
        new = False
    attributes = set(study.user_attrs)
    if attributes <= {OBJECTIVES} and study.directions == directions and not study.get_trials(deepcopy=False):
        study.set_user_attr(OBJECTIVES, [f"{objective.name} [{objective.unit}]" for objective in problem.objectives])
        study.set_user_attr(DEFINITION, dict(definition))
    check_definition(name, definition, study.user_attrs.get(DEFINITION), problem.space)
    return study, new


def definition_in(storage: optuna.storages.BaseStorage, name: str) -> dict[str, Any] | None:
    """The definition of a study in a storage; ``None`` if it is not one of this program.

    Raises:
        ConfigurationError: there is no such study; the message names the nearest.
    """
    studies = {study.study_name: study.user_attrs for study in storage.get_all_studies()}
    if name not in studies:
        raise ConfigurationError(f"--study: {unknown('study', name, sorted(studies))}")
    return studies[name].get(DEFINITION)


def check_definition(
    study: StudyName, definition: Mapping[str, Any], stored: Mapping[str, Any] | None, space: Space
) -> None:
    """Check that the definition of a problem with a space agrees with that of a study in a storage.

    Raises:
        ConfigurationError: they differ; the message names the difference. Or the storage has none: the study is not one
            of this program.
    """
    if stored is None:
        raise ConfigurationError(f"{study} exists, but is not a study of this program; {study.another}")
    check_parts(study, definition.get("parts", []), stored.get("parts", []))
    if difference := space.difference(space_from(stored.get("space", []))):
        raise ConfigurationError(f"{study} has another space: {difference}; {study.another}")
    for key, value in definition.items():
        if key not in {"space", "parts"} and value != stored.get(key):
            values = f": {value!r} here, {stored.get(key)!r} there" if len(repr(value)) < 100 else ""
            raise ConfigurationError(f"{study} was begun with {another(key)}{values}; {study.another}")
