"""The journal file of a study, in Optuna's format: locked for one process, and mended after a kill."""

import fcntl
import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

from dualwinch.model.errors import ConfigurationError


class HeldLock(JournalFileOpenLock):
    """Optuna's lock of a file that is `locked` already; it leaves nothing behind when the process is killed."""

    def acquire(self) -> bool:
        """Whether the lock was acquired."""
        return True

    def release(self) -> None:
        """Nothing: the lock is released with the file."""


class ResumableJournal(JournalFileBackend):
    """Optuna's journal file, whose failures, such as a full disk, name it and the way to continue."""

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Write records.

        Raises:
            OSError: they cannot be written.
        """
        try:
            super().append_logs(logs)
        except OSError as error:
            reason = f"{error.strerror}; the trials until now are kept, --resume continues with them"
            raise OSError(error.errno, reason, self._file_path) from error


def journal_storage(path: Path) -> JournalStorage:
    """The storage of a journal file that this process has `locked`."""
    return JournalStorage(ResumableJournal(str(path), lock_obj=HeldLock(str(path))))


def locked(path: Path) -> IO[bytes]:
    """The file, locked until it is closed or the process ends; created if missing.

    Raises:
        ConfigurationError: it cannot be written, or another process has locked it.
    """
    try:
        handle = path.open("ab")
    except OSError as error:
        raise ConfigurationError(f"--storage {path}: cannot be written ({error.strerror})") from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        raise ConfigurationError(
            f"--storage {path}: another process is writing it; a study of several processes needs a database"
        ) from None
    return handle


def mend(path: Path) -> None:
    """Cut off an incomplete last line, left by a killed process.

    Raises:
        ConfigurationError: a file that is not empty and does not begin like a journal, whose only line may be
            incomplete.
    """
    with path.open("r+b") as file:
        content = file.read()
        beginning = content.partition(b"\n")
        if not _is_journal(beginning[0] + beginning[1]):
            raise ConfigurationError(f"--storage {path}: is not the journal of a study")
        file.truncate(content.rfind(b"\n") + 1)


BEGINNING = b'{"op_code":'
"""Beginning of every line of a journal."""


def _is_journal(line: bytes) -> bool:
    """Whether a file with a first line is empty or a journal."""
    try:
        return not line or (isinstance(json.loads(line), dict) and line.startswith(BEGINNING))
    except ValueError:
        return not line.endswith(b"\n") and BEGINNING.startswith(line[: len(BEGINNING)])


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer interrupts to the end of the block.

    Only the main thread is ever interrupted; in others this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: signals.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        if signals:
            signal.raise_signal(signal.SIGINT)
