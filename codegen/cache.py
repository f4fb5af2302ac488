"""Cache of compiled libraries, in a folder to which no other user was ever able to write.

A library is named ``<key>-<digest>.so``: the key is the fingerprint of its source, the compiler and the processor, the
digest is that of the file itself. A file that does not match its digest (truncated, damaged) is deleted and built
again. Files get their final name by an atomic rename, so that neither concurrent nor killed builds leave incomplete
libraries. Files of any other name or owner are neither used nor touched.

Writing a source can take longer than its compilation. An empty file ``<recipe>-<key>.recipe`` maps a recipe, the
fingerprint of everything that determines a source, to its library, without writing the source again. Concurrent threads
and processes of one machine wait for the first one to build a recipe.

Whoever can write to the folder of libraries, or to one above it, decides what is run. A folder is therefore trusted by
the rules of ssh for the folder of its keys: it and its files belong to the user, and no other user may write to it or
to any folder above it. A folder that is not trusted is left unchanged; libraries are then built in a temporary folder
of the process.
"""

import contextlib
import ctypes
import errno
import hashlib
import math
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from platformdirs import user_cache_path

from dualwinch.codegen.compiler import Compiler, fingerprint
from dualwinch.codegen.errors import CacheError, CacheWarning

NAME = "dualwinch-libraries"
"""Name of the folder, below ``DUALWINCH_CACHE_DIR`` or the user's cache folder, of which nothing else is touched."""

MARKER = "CACHEDIR.TAG"
"""File that marks a folder made by this module, by the Cache Directory Tagging Specification, for backups."""

TAG = """Signature: 8a477f597d28d172789f06886806bc55
# Compiled libraries of dualwinch, which makes them anew when they are gone. See https://bford.info/cachedir/
"""

HINT = "set DUALWINCH_CACHE_DIR to a folder that only you may write to"

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

POSIX = hasattr(os, "getuid")
"""Other systems have no owners and modes to check; a user's folders are private there."""


def cache_folder() -> Path:
    """The folder of compiled libraries, created with mode 0700 if it does not exist.

    If it cannot be trusted or written to, or is mounted noexec, a temporary folder of this process replaces it, with a
    `CacheWarning`.

    Raises:
        CacheError: it cannot be created or read.
    """
    stated_folder = os.environ.get("DUALWINCH_CACHE_DIR")
    try:
        folder = Path(stated_folder or user_cache_path("dualwinch")).absolute() / NAME
    except RuntimeError as error:  # neither HOME nor an entry of the user
        return _substitute(str(error))
    try:
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        reason = _untrusted_parent(folder) or _untrusted(folder) or _useless(folder)
        return _substitute(reason) if reason else folder
    except OSError as error:
        no_home = error.errno in {errno.ENOTDIR, errno.ENOENT} and not stated_folder  # services with HOME=/dev/null
        if no_home or error.errno in {errno.EROFS, errno.EACCES, errno.EPERM}:
            return _substitute(f"{folder}: {error.strerror}")
        raise CacheError(f"cannot use the cache folder {folder}: {error.strerror}; {HINT}") from error


def own(file: Path) -> bool:
    """Whether a path is a regular file of the user to which no other user may write."""
    facts = file.lstat()
    if not stat.S_ISREG(facts.st_mode):
        return False
    return not POSIX or (facts.st_uid == os.getuid() and not facts.st_mode & OTHERS_WRITE)


def _untrusted_parent(folder: Path) -> str:
    """Reason why a folder above cannot be trusted; empty without one.

    In a folder to which every user may write, the sticky bit prevents them from replacing another user's folder.
    """
    parent = folder.parent.resolve(strict=True)
    for above in (parent, *parent.parents) if POSIX else ():
        facts = above.stat()
        if facts.st_uid not in {0, os.getuid()}:
            return f"{above} belongs to another user"
        if _others_write(facts) and not facts.st_mode & stat.S_ISVTX:
            return f"others may write to {above}"
    return ""


def _untrusted(folder: Path) -> str:
    """Create a folder with its marker if missing; reason why an existing one cannot be trusted, else empty."""
    folder.mkdir(mode=0o700, exist_ok=True)
    facts = folder.lstat()
    if not stat.S_ISDIR(facts.st_mode):
        return f"{folder} is a link"
    if POSIX and facts.st_uid != os.getuid():
        return f"{folder} belongs to another user"
    marker = folder / MARKER
    marked = os.path.lexists(marker)
    if POSIX and facts.st_mode & OTHERS_WRITE:
        if marked and own(marker):
            marker.unlink()  # others may have left files, so the folder stays untrusted even if it is closed later
        return f"others may write to {folder}"
    if not marked and not any(folder.iterdir()):
        marker.touch(mode=0o600)
        marker.write_text(TAG)
    if not os.path.lexists(marker) or not own(marker):  # another process may have created it since
        return f"{folder} was open to others, or was not made by dualwinch: remove it"
    return ""


def _useless(folder: Path) -> str:
    """Reason why libraries cannot be written to a folder or run from it; empty without one."""
    if not os.access(folder, os.W_OK):
        return f"{folder} is read-only"
    if POSIX and os.statvfs(folder).f_flag & getattr(os, "ST_NOEXEC", 0):
        return f"nothing may be run from {folder} (mounted noexec)"
    return ""


def _others_write(facts: os.stat_result) -> bool:
    """Whether others may write to a folder; the user's private group does not count as another."""
    return bool(facts.st_mode & stat.S_IWOTH) or bool(facts.st_mode & stat.S_IWGRP and not _private(facts.st_gid))


@cache
def _private(group: int) -> bool:
    """Whether a group is the user's private group: the user's name, and no other member."""
    import grp
    import pwd

    try:
        user, entry = pwd.getpwuid(os.getuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return group == user.pw_gid and entry.gr_name == user.pw_name and set(entry.gr_mem) <= {user.pw_name}


@cache
def _substitute(reason: str) -> Path:
    """A temporary folder of this process, deleted at its end."""
    faults = [reason]
    for parent in (None, *filter(os.path.isdir, PARENTS)):
        try:
            folder = tempfile.TemporaryDirectory(prefix=f"{NAME}-", dir=parent, ignore_cleanup_errors=True)
        except OSError as error:
            faults.append(f"{parent or 'temporary folders'}: {error.strerror}")
            continue
        _substitutes.append(folder)
        if fault := _untrusted_parent(Path(folder.name)) or _useless(Path(folder.name)):
            faults.append(fault)
            continue
        warnings.warn(
            f"compiled libraries are not kept: {reason}; they are built anew in {folder.name}",
            CacheWarning,
            stacklevel=3,
        )
        return Path(folder.name)
    raise CacheError(f"no folder for compiled libraries: {', and '.join(faults)}; {HINT}")


PARENTS = ("/var/tmp", "/dev/shm", "/run/shm", os.environ.get("XDG_RUNTIME_DIR", ""), ".")  # noqa: S108
"""Folders for a temporary folder where the usual one is of no use."""


_substitutes: list[tempfile.TemporaryDirectory[str]] = []
"""Temporary folders, deleted at the end of the process."""


ABANDONED_AFTER = 3600.0
"""Age in s at which an unfinished build counts as abandoned."""

BEING_LOADED = 60.0
"""Age in s since its last use below which another process may be about to load a library."""

LIBRARY = re.compile(r"[0-9a-f]{32}-[0-9a-f]{32}\.so")
RECIPE = re.compile(r"[0-9a-f]{32}-[0-9a-f]{32}\.recipe")
UNFINISHED = re.compile(r"unfinished-\d+-[0-9a-f]{8}\.so")
BUILD = re.compile(r"build-\w{8}")
LOCK = re.compile(r"[0-9a-f]{32}\.lock")
"""Names of the files of the cache folder; builds are folders."""


@dataclass(frozen=True)
class CacheLimits:
    """Limits of the cache; the least recently used libraries are deleted first, those of this process never.

    Attributes:
        megabytes: total size of all libraries; ``DUALWINCH_CACHE_MB``.
        days: time since the last use of each; ``DUALWINCH_CACHE_DAYS``.
    """

    megabytes: float = 1000.0
    days: float = 60.0


def cache_limits() -> CacheLimits:
    """The limits from the environment, else the defaults.

    Raises:
        CacheError: one is no number, or negative.
    """
    limits: dict[str, float] = {}
    for key, name in (("megabytes", "DUALWINCH_CACHE_MB"), ("days", "DUALWINCH_CACHE_DAYS")):
        if text := os.environ.get(name):
            try:
                limits[key] = float(text)
            except ValueError:
                limits[key] = -1.0
            if not limits[key] >= 0:
                raise CacheError(f"{name} = {text!r}: must be a number >= 0")
    return CacheLimits(**limits)


_used: set[Path] = set()
"""Libraries used by this process."""

_builds: list[tuple[float, float]] = []
"""Start and end times in s of every build of this process, including the writing of its source."""


def build_seconds() -> float:
    """Wall time in s that this process has spent writing sources and building libraries; parallel builds count once."""
    seconds, until = 0.0, -math.inf
    for began, ended in sorted(_builds):
        seconds += max(0.0, ended - max(began, until))
        until = max(until, ended)
    return seconds


Source: TypeAlias = str | Callable[[], str]
"""One translation unit, or a function that writes it."""


def library(source: Source, compiler: Compiler, extra_flags: tuple[str, ...] = (), recipe: str = "") -> Path:
    """The compiled library of a C source, from the cache or newly built.

    Args:
        source: one translation unit, or a function that writes it if no library of the recipe is known.
        compiler: the compiler.
        extra_flags: flags in addition to the compiler's own.
        recipe: fingerprint of everything that determines the source; empty: none.

    Raises:
        CompileError: the compiler fails.
        CacheError: the cache folder cannot be used, or a limit of it is invalid.
    """
    folder, limits = cache_folder(), cache_limits()
    build = compiler.identity, *extra_flags
    recipe = recipe and fingerprint(recipe, *build)
    path = _look_up_recipe(folder, recipe) if recipe else None
    if path is None and recipe:
        with _alone(folder, recipe):
            path = _look_up_recipe(folder, recipe) or _made(folder, source, compiler, extra_flags, limits, recipe)
    path = path or _made(folder, source, compiler, extra_flags, limits)
    _used.add(path)
    return path


def _made(
    folder: Path,
    source: Source,
    compiler: Compiler,
    extra_flags: tuple[str, ...],
    limits: CacheLimits,
    recipe: str = "",
) -> Path:
    """The library of a source, from the cache or newly built, and recorded for its recipe."""
    began = time.monotonic()
    text = source if isinstance(source, str) else source()
    key = fingerprint(text, compiler.identity, *extra_flags)
    path = _look_up(folder, key)
    if path is None:
        path = _build(folder, key, text, compiler, extra_flags)
        _builds.append((began, time.monotonic()))
        _used.add(path)
        _sweep(folder, limits)
    if recipe:
        with contextlib.suppress(OSError):
            (folder / f"{recipe}-{key}.recipe").touch(mode=0o600)
    return path


@contextlib.contextmanager
def _alone(folder: Path, recipe: str) -> Iterator[None]:
    """Wait while another thread or process of this machine builds the library of a recipe.

    Without file locks each builds its own.
    """
    lock = folder / f"{recipe}.lock"
    try:
        import fcntl

        file = lock.open("ab")
    except (ImportError, OSError):
        yield
        return
    with file:
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


class Array:
    """An argument of a C function: an array, passed as the address of its data, or an address (None for null)."""

    @classmethod
    def from_param(cls, value: Any) -> Any:
        """The argument for ctypes."""
        return ctypes.c_void_p.from_param(value.ctypes.data if isinstance(value, np.ndarray) else value)


ARGUMENTS = {"p": Array, "n": ctypes.c_int64, "x": ctypes.c_double}
RETURNED = {"": None, "int": ctypes.c_int, "n": ctypes.c_int64}
"""Letters in signatures: an array, a count, a number."""


def loaded(
    source: Source, compiler: Compiler, extra_flags: tuple[str, ...] = (), recipe: str = "", **signatures: str
) -> ctypes.CDLL:
    """The library of a C source, loaded, with the signatures of its functions.

    Args:
        source: one translation unit, or a function that writes it if no library of the recipe is known.
        compiler: the compiler.
        extra_flags: flags in addition to the compiler's own.
        recipe: as in `library`.
        signatures: signature of each function, a letter per argument and the result, as in ``"ppn -> int"``. Arrays
            must be C-contiguous; calls release the global interpreter lock.

    Raises:
        CompileError, CacheError: as in `library`.
    """
    native_library = ctypes.CDLL(str(library(source, compiler, extra_flags, recipe)))
    for name, signature in signatures.items():
        arguments, _, returned = signature.partition(" -> ")
        function = getattr(native_library, name)
        function.argtypes, function.restype = [ARGUMENTS[letter] for letter in arguments], RETURNED[returned]
    return native_library


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:32]


def _beginning_with(folder: Path, beginning: str) -> list[Path]:
    """Files of a folder by the prefix of their names; much faster than a glob for thousands of files."""
    with os.scandir(folder) as entries:
        return [folder / entry.name for entry in entries if entry.name.startswith(beginning)]


def _look_up(folder: Path, key: str) -> Path | None:
    for file in _beginning_with(folder, f"{key}-"):
        with contextlib.suppress(OSError):
            if not LIBRARY.fullmatch(file.name) or not own(file):
                continue
            if file.stem.partition("-")[2] == _digest(file):
                os.utime(file)
                return file
            file.unlink()
    return None


def _look_up_recipe(folder: Path, recipe: str) -> Path | None:
    for file in _beginning_with(folder, f"{recipe}-"):
        with contextlib.suppress(FileNotFoundError):  # another process may delete it
            if RECIPE.fullmatch(file.name) and own(file) and (path := _look_up(folder, file.stem.partition("-")[2])):
                return path
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
    return finished


def libraries(folder: Path) -> list[Path]:
    """The compiled libraries in the cache folder, the most recently used first."""
    dated_paths: list[tuple[float, Path]] = []
    for file in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another process may delete it
            if LIBRARY.fullmatch(file.name) and own(file):
                dated_paths.append((file.lstat().st_mtime, file))
    return [file for _, file in sorted(dated_paths, reverse=True)]


def _sweep(folder: Path, limits: CacheLimits) -> None:
    """Delete remains of killed builds, and libraries beyond the limits."""
    now = time.time()
    with contextlib.suppress(OSError):
        for entry in folder.iterdir():
            if now - entry.lstat().st_mtime <= ABANDONED_AFTER:
                continue
            if (UNFINISHED.fullmatch(entry.name) or LOCK.fullmatch(entry.name)) and own(entry):
                entry.unlink()
            elif BUILD.fullmatch(entry.name) and entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
    size = 0
    for file in libraries(folder):
        with contextlib.suppress(OSError):  # another process may delete it, or have it loaded
            facts = file.lstat()
            size, age = size + facts.st_size, now - facts.st_mtime
            expired = size > 1e6 * limits.megabytes or age > 86400 * limits.days
            if expired and file not in _used and age > BEING_LOADED:
                file.unlink()
                size -= facts.st_size
    keys = {file.name.partition("-")[0] for file in libraries(folder)}
    for file in folder.iterdir():
        with contextlib.suppress(OSError):
            if RECIPE.fullmatch(file.name) and own(file) and file.stem.partition("-")[2] not in keys:
                file.unlink()
