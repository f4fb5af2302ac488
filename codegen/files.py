"""Atomic writing of files: they appear whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to it at the end, and removed after an error or interrupt.

    Args:
        path: the final file; the temporary name has the same suffix.

    Raises:
        OSError: the folder cannot be written to, or the disk is full.
    """
    unfinished = path.with_name(f".{path.stem}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


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
