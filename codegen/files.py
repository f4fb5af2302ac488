"""Files that appear whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A path to write to beside `path`, renamed to it at the end; gone if anything fails or is interrupted.

    Args:
        path: the file that shall appear; its suffix is kept in the name written to.

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
    """Write a text as UTF-8; the file appears whole or not at all.

    Args:
        path: the file.
        text: its content.
        errors: what becomes of a character that has no UTF-8, as `str.encode` says.

    Raises:
        OSError: as by `atomic`.
    """
    with atomic(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8", errors=errors)
