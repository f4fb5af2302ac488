"""Folders for output files, checked before anything is computed."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dualwinch.model.errors import ConfigurationError


def check_folder(folder: Path) -> None:
    """Check that files can be written to a folder.

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
    """Check that a file can be written: its folder by `check_folder`, and that its name is not a folder's.

    Raises:
        ConfigurationError: it cannot.
    """
    check_folder(file.parent)
    if file.is_dir():
        raise ConfigurationError(f"{file}: is a folder; must be the name of a file")


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, and check it by `check_folder`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"{folder}: cannot be made ({error.strerror})") from error
    check_folder(folder)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder as context; after an exception, remove folders that were made here and are still empty."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        make_folder(folder)
        yield
    except BaseException:
        for path in new:
            with suppress(OSError):  # not made, or not empty
                path.rmdir()
        raise
