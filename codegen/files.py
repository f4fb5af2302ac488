"""Atomic writing of files: they appear whole or not at all."""

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

WRITTEN: ContextVar[list[Path] | None] = ContextVar("WRITTEN", default=None)
"""The files written so far, where someone keeps a list of them."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to it at the end, and removed after an error or interrupt.

    Args:
        path: the final file, or a symbolic link to it; the temporary name has the same suffix.

    Raises:
        OSError: the folder cannot be written to, or the disk is full; it names `path`.
    """
    final = Path(os.path.realpath(path))  # else the rename would replace a link
    unfinished = final.with_name(f".{final.stem}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        yield unfinished
        unfinished.replace(final)
        written = WRITTEN.get()
        if written is not None:
            written.append(path)
    except OSError as error:
        if error.filename not in {None, str(unfinished)}:
            raise
        number = error.errno or _number_in(str(error))
        raise OSError(number, os.strerror(number) if number else str(error), str(path)) from error
    finally:
        unfinished.unlink(missing_ok=True)


def _number_in(message: str) -> int:
    """The error number that a library gives in its message alone; 0: none."""
    match = re.search(r"\[errno (\d+)\]", message, re.IGNORECASE)
    return int(match[1]) if match else 0


def write_whole(path: Path, text: str, errors: str = "strict") -> None:
    """Write a text as UTF-8, atomically.

    Args:
        path: the file.
        text: its content.
        errors: treatment of characters without UTF-8, as in `str.encode`.

    Raises:
        OSError: as in `atomic`.
    """
    with atomic(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8", errors=errors)
