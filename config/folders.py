"""Folders that files are to be written to, checked before anything is computed."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dualwinch.model.errors import ConfigurationError


def check_folder(folder: Path) -> None:
    """Find out now whether files can be written to a folder.

    Raises:
        ConfigurationError: it does not exist, is no folder or cannot be written to.
    """
    if not folder.is_dir():
        raise ConfigurationError(f"{folder}: no such folder")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ConfigurationError(f"{folder}: cannot be written to ({error.strerror})") from error


def check_place(file: Path) -> None:
    """Find out now whether a file can be written: `check_folder` of its folder, and that it is no folder itself.

    Raises:
        ConfigurationError: it cannot.
    """
    check_folder(file.parent)
    if file.is_dir():
        raise ConfigurationError(f"{file}: is a folder; must be the name of a file")


def make_folder(folder: Path) -> None:
    """Make a folder, with those above it, and `check_folder`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"{folder}: cannot be made ({error.strerror})") from error
    check_folder(folder)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """`make_folder` for what is done in here; where that fails, no folder is left that is new and still empty."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        make_folder(folder)
        yield
    except BaseException:
        for path in new:
            with suppress(OSError):  # it was not made, or something is in it
                path.rmdir()
        raise
