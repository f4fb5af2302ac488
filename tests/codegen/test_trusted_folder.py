"""Whose libraries are run: the folder of compiled libraries among files that are not its own, and under attack."""

import ctypes
import errno
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from dualwinch.cli import main
from dualwinch.codegen import cache
from dualwinch.codegen.cache import MARKER, NAME, cache_folder, library
from dualwinch.codegen.compiler import find_compiler, fingerprint
from dualwinch.codegen.errors import CacheError, CacheWarning

pytestmark = pytest.mark.skipif(os.name != "posix", reason="owners and permission bits")

SOURCE = '__attribute__((visibility("default"))) int answer(void) { return 42; }\n'
PLANTED = SOURCE.replace("42", "13")

SOMEBODY = 65534
"""A user that is not the one who runs the tests."""

AS_ROOT = pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="gives files to another user")


@pytest.fixture(autouse=True)
def given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that ``DUALWINCH_CACHE_DIR`` names."""
    cache._substitute.cache_clear()
    folder = tmp_path / "given"
    folder.mkdir(mode=0o755)
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(folder))
    return folder


def answer(path: Path) -> int:
    return ctypes.CDLL(str(path)).answer()


def plant(folder: Path) -> Path:
    """A library of other code, under the name by which that of `SOURCE` is found."""
    compiler = find_compiler()
    unnamed = folder / "planted.so"
    compiler.build(PLANTED, unnamed)
    path = folder / f"{fingerprint(SOURCE, compiler.identity)}-{cache._digest(unnamed)}.so"
    return unnamed.rename(path)


def mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


def built_elsewhere(reason: str) -> Path:
    """The library of `SOURCE`, which must be one of this process alone, with a warning that says why."""
    with pytest.warns(CacheWarning, match="compiled libraries are not kept: ") as caught:
        path = library(SOURCE, find_compiler())
    (warning,) = caught
    assert reason in str(warning.message)
    assert "\n" not in str(warning.message)
    assert path.parent != Path(os.environ.get("DUALWINCH_CACHE_DIR", os.devnull)) / NAME
    assert mode(path.parent) == 0o700
    assert answer(path) == 42
    return path


def test_a_folder_of_its_own_with_a_marker(given: Path) -> None:
    folder = cache_folder()
    assert folder == given / NAME
    assert mode(folder) == 0o700
    assert (folder / MARKER).read_text().startswith("Signature: 8a477f597d28d172789f06886806bc55\n")
    assert cache_folder() == folder


def test_what_else_is_in_the_folder_stays_as_it_is(given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DUALWINCH_CACHE_MB", "0")
    monkeypatch.setattr(cache, "BEING_LOADED", -1.0)
    monkeypatch.setattr(cache, "ABANDONED_AFTER", -1.0)
    theirs = given / "theirs"
    theirs.mkdir()
    (theirs / "thesis.tex").write_text("years of work")
    names = ["my-own.so", f"{'a' * 32}-{'b' * 32}.so", "unfinished-1-0000dead.so", "build-x/unit.c", "build-12345678/a"]
    for folder in (given, cache_folder()):
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text("mine")
        (folder / "build-abcdefgh").symlink_to(theirs)
    first = library(SOURCE, find_compiler())
    cache._used.discard(first)
    second = library(PLANTED, find_compiler())
    assert second.exists()
    assert not first.exists()
    assert all((given / name).read_text() == "mine" for name in names)
    assert mode(given) == 0o755
    left = {file.name for file in cache_folder().iterdir()}
    assert left == {MARKER, second.name, "my-own.so", "build-x", "build-abcdefgh"}
    assert (theirs / "thesis.tex").read_text() == "years of work"


def test_libraries_of_a_folder_that_is_open_are_not_run(given: Path) -> None:
    folder = cache_folder()
    planted = plant(folder)
    folder.chmod(0o777)
    built_elsewhere(f"others may write to {folder}")
    assert mode(folder) == 0o777
    assert planted.exists()
    folder.chmod(0o700)
    built_elsewhere("was open to others")
    shutil.rmtree(folder)
    path = library(SOURCE, find_compiler())
    assert path.parent == given / NAME
    assert answer(path) == 42


def test_a_library_that_others_may_write_to_is_built_anew() -> None:
    planted = plant(cache_folder())
    assert answer(library(SOURCE, find_compiler())) == 13, "of one's own it would be run"
    planted.chmod(0o722)
    path = library(SOURCE, find_compiler())
    assert path != planted
    assert mode(path) == 0o700


def test_a_link_to_a_library_is_not_followed(tmp_path: Path) -> None:
    planted = plant(cache_folder())
    planted.rename(tmp_path / "elsewhere.so")
    planted.symlink_to(tmp_path / "elsewhere.so")
    assert library(SOURCE, find_compiler()) != planted


@pytest.mark.parametrize("open_to", [0o777, 0o757])
def test_a_folder_above_that_is_open(open_to: int, given: Path) -> None:
    given.chmod(open_to)
    built_elsewhere(f"others may write to {given}")
    assert mode(given) == open_to
    given.chmod(0o1777)
    assert cache_folder() == given / NAME


def test_a_link_in_place_of_the_folder(given: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (given / NAME).symlink_to(tmp_path / "other")
    built_elsewhere("is a link")
    assert not list((tmp_path / "other").iterdir())


def test_a_folder_that_somebody_has_filled_is_not_its_own(given: Path) -> None:
    (given / NAME).mkdir(mode=0o700)
    (given / NAME / "notes.txt").write_text("mine")
    built_elsewhere("was not made by dualwinch")
    assert [file.name for file in (given / NAME).iterdir()] == ["notes.txt"]


@AS_ROOT
def test_files_of_somebody_else(given: Path) -> None:
    planted = plant(cache_folder())
    os.chown(planted, SOMEBODY, SOMEBODY)
    assert answer(library(SOURCE, find_compiler())) == 42
    assert planted.exists()
    os.chown(given / NAME / MARKER, SOMEBODY, SOMEBODY)
    built_elsewhere("was not made by dualwinch")
    os.chown(given / NAME, SOMEBODY, SOMEBODY)
    built_elsewhere(f"{given / NAME} belongs to another user")
    os.chown(given, SOMEBODY, SOMEBODY)
    built_elsewhere(f"{given} belongs to another user")


@AS_ROOT
def test_a_group_of_ones_own_is_nobody_else(given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given.chmod(0o775)
    assert cache_folder() == given / NAME
    monkeypatch.setattr(cache, "_private", lambda _: False)
    built_elsewhere(f"others may write to {given}")


def test_no_folder_at_all(given: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given.chmod(0o777)
    open_one = tmp_path / "tmp"
    open_one.mkdir()
    open_one.chmod(0o777)
    monkeypatch.setattr("tempfile.tempdir", str(open_one))
    monkeypatch.setattr(cache, "PARENTS", ())
    with pytest.raises(CacheError, match="set DUALWINCH_CACHE_DIR to a folder that only you may write to"):
        cache_folder()


@pytest.mark.filterwarnings("default::dualwinch.codegen.errors.CacheWarning")
def test_the_command_line_says_so_in_a_line(given: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given.chmod(0o777)
    main(["doctor"])
    said = capsys.readouterr().err
    assert re.fullmatch(rf"dualwinch: warning: compiled libraries are not kept: others may .*{NAME}-\w+\n", said)


def test_a_folder_of_a_process_goes_with_it(given: Path) -> None:
    given.chmod(0o777)
    program = "from dualwinch.codegen.cache import cache_folder; print(cache_folder())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert NAME in done.stdout
    assert not Path(done.stdout.strip()).exists()


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077])
def test_whatever_the_umask_a_library_is_found_again(umask: int) -> None:
    before = os.umask(umask)
    try:
        assert library(SOURCE, find_compiler()) == library(SOURCE, find_compiler())
        assert mode(library(SOURCE, find_compiler())) == 0o700
    finally:
        os.umask(before)


def test_a_folder_that_cannot_be_written_to_or_made(given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("os.access", lambda path, _: Path(path) != given / NAME)
        built_elsewhere(f"{given / NAME} is read-only")
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(given / "further"))

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    with monkeypatch.context() as patched:
        patched.setattr(cache, "_untrusted", refuse)
        built_elsewhere("Read-only file system")


def test_a_home_that_is_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DUALWINCH_CACHE_DIR")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", os.devnull)
    built_elsewhere("Not a directory")


def test_a_folder_that_nothing_may_be_run_from(given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    of_folder, noexec = os.statvfs, SimpleNamespace(f_flag=os.ST_NOEXEC)
    monkeypatch.setattr("os.statvfs", lambda path: noexec if Path(path) == given / NAME else of_folder(path))
    built_elsewhere("mounted noexec")
