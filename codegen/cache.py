"""Compiled libraries, kept in the user's own cache folder (`codegen.trusted_folder`).

A library is named ``<key>-<digest>.so``: the key is the fingerprint of its source and of everything about the
compiler and the processor, the digest is that of the file itself. A file whose content is not what its name says
(truncated, damaged) is thrown away and built again. Files arrive under their final name by one atomic rename, so
processes that build the same library at once, and builds that are killed, leave nothing that could be taken for
a library. Files of any other name, or of somebody else, are neither used nor touched.
"""

import contextlib
import hashlib
import os
import re
import secrets
import shutil
import time
from pathlib import Path

from dualwinch.codegen.compiler import Compiler, fingerprint
from dualwinch.codegen.errors import CacheError
from dualwinch.codegen.trusted_folder import cache_folder, own

ABANDONED_AFTER = 3600.0
"""Age in s at which an unfinished build counts as abandoned."""

KEPT = 200
"""Libraries kept; the ones used longest ago go first."""

LIBRARY = re.compile(r"[0-9a-f]{32}-[0-9a-f]{32}\.so")
UNFINISHED = re.compile(r"unfinished-\d+-[0-9a-f]{8}\.so")
BUILD = re.compile(r"build-\w{8}")
"""Names of what is put into the cache folder; builds are folders."""


def library(source: str, compiler: Compiler, extra_flags: tuple[str, ...] = ()) -> Path:
    """The compiled library of a C source, from the cache or newly built.

    Args:
        source: one translation unit.
        compiler: what builds it.
        extra_flags: beside the compiler's own.

    Raises:
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used.
    """
    folder = cache_folder()
    key = fingerprint(source, compiler.identity, *extra_flags)
    return _look_up(folder, key) or _build(folder, key, source, compiler, extra_flags)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:32]


def _look_up(folder: Path, key: str) -> Path | None:
    for file in folder.glob(f"{key}-*.so"):
        with contextlib.suppress(OSError):
            if not LIBRARY.fullmatch(file.name) or not own(file):
                continue
            if file.stem.partition("-")[2] == _digest(file):
                os.utime(file)
                return file
            file.unlink()
    return None


def _build(folder: Path, key: str, source: str, compiler: Compiler, extra_flags: tuple[str, ...]) -> Path:
    unfinished = folder / f"unfinished-{os.getpid()}-{secrets.token_hex(4)}.so"
    try:
        compiler.build(source, unfinished, extra_flags)
        unfinished.chmod(0o700)
        with unfinished.open("rb+") as file:
            os.fsync(file.fileno())
        finished = folder / f"{key}-{_digest(unfinished)}.so"
        unfinished.replace(finished)
    except OSError as error:
        raise CacheError(f"cannot write to the cache folder {folder}: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)
    _sweep(folder)
    return finished


def libraries(folder: Path) -> list[Path]:
    """The compiled libraries in the cache folder, those used last first."""
    found = [(file.lstat().st_mtime, file) for file in folder.iterdir() if LIBRARY.fullmatch(file.name) and own(file)]
    return [file for _, file in sorted(found, reverse=True)]


def _sweep(folder: Path) -> None:
    """Remove what killed builds left behind, and the libraries beyond `KEPT`."""
    now = time.time()
    with contextlib.suppress(OSError):
        for left in folder.iterdir():
            if now - left.lstat().st_mtime <= ABANDONED_AFTER:
                continue
            if UNFINISHED.fullmatch(left.name) and own(left):
                left.unlink()
            elif BUILD.fullmatch(left.name) and left.is_dir() and not left.is_symlink():
                shutil.rmtree(left)
        for file in libraries(folder)[KEPT:]:
            file.unlink()
