"""Compiled libraries, kept in the user's own cache folder.

A library is named ``<key>-<digest>.so``: the key is the fingerprint of its source and of everything about the
compiler and the processor, the digest is that of the file itself. A file whose content is not what its name says
(truncated, damaged) is thrown away and built again. Files arrive under their final name by one atomic rename, so
processes that build the same library at once, and builds that are killed, leave nothing that could be taken for
a library.
"""

import contextlib
import hashlib
import os
import secrets
import time
from pathlib import Path

from platformdirs import user_cache_path

from dualwinch.codegen.compiler import Compiler, fingerprint
from dualwinch.codegen.errors import CacheError

ABANDONED_AFTER = 3600.0
"""Age in s at which an unfinished build counts as abandoned."""

KEPT = 200
"""Libraries kept; the ones used longest ago go first."""


def cache_folder() -> Path:
    """The folder of compiled libraries, ``DUALWINCH_CACHE_DIR`` or the user's cache folder; created with mode 0700.

    Raises:
        CacheError: the folder cannot be made or belongs to somebody else.
    """
    given = os.environ.get("DUALWINCH_CACHE_DIR")
    folder = Path(given) if given else user_cache_path("dualwinch")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        facts = folder.stat()
        if hasattr(os, "getuid"):
            if facts.st_uid != os.getuid():
                raise CacheError(f"the cache folder {folder} belongs to another user; set DUALWINCH_CACHE_DIR")
            if facts.st_mode & 0o077:
                folder.chmod(0o700)
    except OSError as error:
        hint = "set DUALWINCH_CACHE_DIR to a folder you may write to"
        raise CacheError(f"cannot use the cache folder {folder}: {error.strerror}; {hint}") from error
    return folder


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
            if file.stem.partition("-")[2] == _digest(file):
                os.utime(file)
                return file
            file.unlink()
    return None


def _build(folder: Path, key: str, source: str, compiler: Compiler, extra_flags: tuple[str, ...]) -> Path:
    unfinished = folder / f"unfinished-{os.getpid()}-{secrets.token_hex(4)}.so"
    try:
        compiler.build(source, unfinished, extra_flags)
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


def _sweep(folder: Path) -> None:
    """Remove what killed builds left behind, and the libraries beyond `KEPT`."""
    now = time.time()
    with contextlib.suppress(OSError):
        for left in (*folder.glob("unfinished-*"), *folder.glob("build-*")):
            if now - left.stat().st_mtime > ABANDONED_AFTER:
                if left.is_dir():
                    for file in left.iterdir():
                        file.unlink()
                    left.rmdir()
                else:
                    left.unlink()
        libraries = sorted(folder.glob("*-*.so"), key=lambda file: file.stat().st_mtime, reverse=True)
        for file in libraries[KEPT:]:
            file.unlink()
