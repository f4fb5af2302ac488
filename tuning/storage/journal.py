"""A study in a journal file in Optuna's format, written by a single process or by several.

A trial is one line, written when it is finished, so that an interrupted batch leaves nothing behind. A single process
writes lines once per batch and never reads them again: the cost of a trial does not depend on their number.

In a folder shared by several machines, processes on all of them may work on a study (`SharedJournalStudy`); Optuna's
lock keeps their lines apart. Only finished trials are written: when a worker dies, only its batch is lost.
"""

import fcntl
import json
import signal
import threading
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import optuna
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.space import Space, space_from
from dualwinch.tuning.storage.record import begun, definitions, evaluation_of, finished_trial, joined_definition
from dualwinch.tuning.storage.shared import FINISHED, WORKER, SharedStudy
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage, TrialClaim


class BufferedJournalFile(JournalFileBackend):
    """A journal file of one process, written when `flush` is called."""

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self._path = path
        self._waiting: list[dict[str, Any]] = []
        with path.open("rb") as lines:
            self._written = sum(1 for _ in lines)

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Keep logs for the next flush."""
        self._waiting += logs

    def read_logs(self, log_number_from: int) -> Generator[dict[str, Any], None, None]:
        """Logs in the file, then the unwritten ones."""
        if log_number_from < self._written:
            yield from super().read_logs(log_number_from)
        for log in self._waiting[max(log_number_from - self._written, 0) :]:
            yield json.loads(json.dumps(log))

    def flush(self) -> None:
        """Write the waiting logs."""
        if self._waiting:
            super().append_logs(self._waiting)
            self._written += len(self._waiting)
            self._waiting = []


class JournalStudy(StudyStorage):
    """Storage of a study in a file, for a single process."""

    def __init__(
        self,
        path: Path,
        study: str,
        problem: TuningProblem,
        definition: Mapping[str, Any],
        budget: SearchBudget,
        *,
        resume: bool,
    ) -> None:
        """Open or create the file; arguments and errors as in `tuning.storage.opening.open_store`."""
        super().__init__(budget)
        self._lock = _locked(path)
        try:
            _mend(path)
            self._file = BufferedJournalFile(path)
            self._storage = optuna.storages.JournalStorage(self._file)
            self._study = begun(study, self._storage, problem, definition, budget, path, resume=resume)
        except BaseException:
            self._lock.close()
            raise
        self._count = len(self._study.get_trials(deepcopy=False, states=FINISHED))
        self._space = problem.space
        self._file.flush()

    def finished(self) -> list[Evaluation]:
        """Every finished trial."""
        return [evaluation_of(trial) for trial in self._study.get_trials(deepcopy=False, states=FINISHED)]

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:  # noqa: ARG002
        """Write finished trials, all at once; an interrupt is deferred until then."""
        with _uninterrupted():
            self._study.add_trials([finished_trial(evaluation, self._space) for evaluation in evaluations])
            self._file.flush()
            self._count += len(evaluations)

    def count(self) -> int:
        """Number of finished trials."""
        return self._count

    def close(self) -> None:
        """Unlock and close the file."""
        self._lock.close()


class SharedJournalStudy(SharedStudy):
    """Storage of a study in a file shared by several processes, as seen by one of them."""

    def __init__(self, path: Path, study: str, lock: IO[bytes], space: Space) -> None:
        """Open an existing study, with this process's lock on the file; see `begin` and `join`."""
        super().__init__(optuna.load_study(study_name=study, storage=_storage(path)), space)
        self._path, self._lock = path, lock

    @classmethod
    def begin(
        cls,
        path: Path,
        study: str,
        problem: TuningProblem,
        definition: Mapping[str, Any],
        budget: SearchBudget,
        *,
        resume: bool,
    ) -> "SharedJournalStudy":
        """Begin or continue a study; arguments and errors as in `tuning.storage.opening.open_store`."""
        with suppress(ConfigurationError), _locked(path):  # not while others work on it
            _mend(path)
        lock = _locked(path, shared=True)
        try:
            begun(study, _storage(path), problem, definition, budget, path, resume=resume)
        except BaseException:
            lock.close()
            raise
        store = cls(path, study, lock, problem.space)
        store.set_budget(budget)
        return store

    @classmethod
    def join(cls, path: Path, study: str) -> "SharedJournalStudy":
        """Join an existing study.

        Raises:
            ConfigurationError: there is no such study, the file is no journal, or a single process uses it
                exclusively.
        """
        if not path.is_file():
            raise ConfigurationError(f"--storage {path}: does not exist; `dualwinch tune --shared` creates it")
        lock = _locked(path, shared=True)
        try:
            _check(path)
            definition = joined_definition(study, _storage(path))
        except BaseException:
            lock.close()
            raise
        return cls(path, study, lock, space_from(definition["space"]))

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:  # noqa: ARG002
        """Write finished trials up to the budget's number; an interrupt is deferred until then."""
        budget, trials = self.budget(), [finished_trial(evaluation, self._space) for evaluation in evaluations]
        with _uninterrupted(), self._finishing():
            left = None if budget.trials is None else max(0, budget.trials - self.count())
            for trial in trials[:left]:
                trial.set_user_attr(WORKER, self._name)
                self._study.add_trial(trial)

    @contextmanager
    def _finishing(self) -> Iterator[None]:
        """Exclude other processes from finishing trials; a dead process's lock is broken after half a minute."""
        lock = JournalFileOpenLock(f"{self._path}.finish")
        lock.acquire()
        try:
            yield
        finally:
            lock.release()

    def close(self) -> None:
        """Unlock and close the file."""
        self._lock.close()


def _storage(path: Path) -> optuna.storages.JournalStorage:
    return optuna.storages.JournalStorage(JournalFileBackend(str(path)))


def definition_in_journal(path: Path, study: str) -> dict[str, Any] | None:
    """The stored definition of a study in a file; ``None`` if there is no such study."""
    if not path.is_file() or not path.stat().st_size:
        return None
    with _locked(path):
        _mend(path)
        return definitions(optuna.storages.JournalStorage(BufferedJournalFile(path))).get(study)


def _locked(path: Path, *, shared: bool = False) -> IO[bytes]:
    """The file, locked until it is closed or the process ends: exclusively, or shared with other such processes."""
    try:
        handle = path.open("ab")
    except OSError as error:
        raise ConfigurationError(f"--storage {path}: cannot be written ({error.strerror})") from error
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        raise ConfigurationError(
            f"--storage {path}: another process is writing it; begin a study of several processes with --shared, or in "
            "a database"
        ) from None
    return handle


def _mend(path: Path) -> None:
    """Cut off an incomplete last line, left by a killed process.

    Raises:
        ConfigurationError: as in `_check`.
    """
    _check(path)
    with path.open("r+b") as file:
        content = file.read()
        file.truncate(content.rfind(b"\n") + 1)


FIRST = b'{"op_code":'
"""Beginning of every line of a journal."""


def _check(path: Path) -> None:
    """Check that a file is empty or begins like a journal, whose only line may be incomplete.

    Raises:
        ConfigurationError: it does not.
    """
    with path.open("rb") as file:
        line = file.readline()
    try:
        known = not line or (isinstance(json.loads(line), dict) and line.startswith(FIRST))
    except ValueError:
        known = not line.endswith(b"\n") and FIRST.startswith(line[: len(FIRST)])
    if not known:
        raise ConfigurationError(f"--storage {path}: is not the journal of a study")


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Defer interrupts to the end of the block.

    Only the main thread is ever interrupted; in others this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        if came:
            signal.raise_signal(signal.SIGINT)
