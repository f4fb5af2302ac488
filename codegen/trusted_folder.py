"""The folder of compiled libraries: one of our own, and one that nobody else was ever able to write to.

A library is code that is run. Whoever can write to its folder, or to one above it, decides what is run. So a folder is
trusted as ssh trusts the folder of its keys: it and its files belong to oneself, and nobody else may write to it or to
anything above it. A folder that is not trusted is left as it is; libraries are then built anew in a folder that lives
as long as the process.
"""

import os
import stat
import tempfile
import warnings
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

from dualwinch.codegen.errors import CacheError, CacheWarning

NAME = "dualwinch-libraries"
"""Of the folder, below ``DUALWINCH_CACHE_DIR`` or the user's cache folder: what else is there is never touched."""

MARKER = "CACHEDIR.TAG"
"""Says that a folder was made here; the name is that of the Cache Directory Tagging Specification, for backups."""

TAG = """Signature: 8a477f597d28d172789f06886806bc55
# Compiled libraries of dualwinch, which makes them anew when they are gone. See https://bford.info/cachedir/
"""

HINT = "set DUALWINCH_CACHE_DIR to a folder that only you may write to"

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

POSIX = hasattr(os, "getuid")
"""Elsewhere there are no owners and modes to look at, and a user's folders are the user's own."""


def cache_folder() -> Path:
    """The folder of compiled libraries; made with mode 0700 where there is none.

    Where it cannot be trusted it is one of this process alone, and a `CacheWarning` says why.

    Raises:
        CacheError: it cannot be made or read.
    """
    given = os.environ.get("DUALWINCH_CACHE_DIR")
    folder = Path(given or user_cache_path("dualwinch")).absolute() / NAME
    try:
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        reason = _doubt_above(folder) or _doubt(folder)
        return _substitute(reason) if reason else folder
    except OSError as error:
        raise CacheError(f"cannot use the cache folder {folder}: {error.strerror}; {HINT}") from error


def own(file: Path) -> bool:
    """Whether a file, no link, is one's own, and nobody else may write to it."""
    facts = file.lstat()
    if not stat.S_ISREG(facts.st_mode):
        return False
    return not POSIX or (facts.st_uid == os.getuid() and not facts.st_mode & OTHERS_WRITE)


def _doubt_above(folder: Path) -> str:
    """Why a folder above cannot be trusted; empty where all can.

    Where everybody may write, the sticky bit keeps others from putting another folder in the place of one's own.
    """
    parent = folder.parent.resolve(strict=True)
    for above in (parent, *parent.parents) if POSIX else ():
        facts = above.stat()
        if facts.st_uid not in {0, os.getuid()}:
            return f"{above} belongs to another user"
        if _others_write(facts) and not facts.st_mode & stat.S_ISVTX:
            return f"others may write to {above}"
    return ""


def _doubt(folder: Path) -> str:
    """Make a folder with its marker where there is none; why it cannot be trusted where there is."""
    folder.mkdir(mode=0o700, exist_ok=True)
    facts = folder.lstat()
    if not stat.S_ISDIR(facts.st_mode):
        return f"{folder} is a link"
    if POSIX and facts.st_uid != os.getuid():
        return f"{folder} belongs to another user"
    marker = folder / MARKER
    names = {file.name for file in folder.iterdir()}
    if POSIX and facts.st_mode & OTHERS_WRITE:
        if MARKER in names and own(marker):
            marker.unlink()  # closing the folder later does not take back what others have left in it
        return f"others may write to {folder}"
    if not names:
        marker.touch(mode=0o600)
        marker.write_text(TAG)
    elif MARKER not in names or not own(marker):
        return f"{folder} was open to others, or is none of dualwinch's: remove it"
    return ""


def _others_write(facts: os.stat_result) -> bool:
    """Whether others may write to a folder; a group that is the user's alone is no other."""
    return bool(facts.st_mode & stat.S_IWOTH) or bool(facts.st_mode & stat.S_IWGRP and not _private(facts.st_gid))


@cache
def _private(group: int) -> bool:
    """Whether a group has the user's name and no further member, as many systems give each user."""
    import grp
    import pwd

    try:
        user, entry = pwd.getpwuid(os.getuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return group == user.pw_gid and entry.gr_name == user.pw_name and set(entry.gr_mem) <= {user.pw_name}


@cache
def _substitute(reason: str) -> Path:
    """A folder of this process alone, gone when it ends."""
    folder = tempfile.TemporaryDirectory(prefix=f"{NAME}-", ignore_cleanup_errors=True)
    _substitutes.append(folder)
    if further := _doubt_above(Path(folder.name)):
        raise CacheError(f"no folder for compiled libraries: {reason}, and {further}; {HINT}")
    warnings.warn(
        f"compiled libraries are not kept: {reason}; they are built anew in {folder.name}", CacheWarning, stacklevel=3
    )
    return Path(folder.name)


_substitutes: list[tempfile.TemporaryDirectory[str]] = []
"""Removed when the process ends."""
