import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dualwinch.codegen import cache
from dualwinch.codegen.cache import MARKER, CacheLimits, cache_folder, cache_limits, libraries, library
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.errors import CacheError, CompileError

POSIX = pytest.mark.skipif(os.name != "posix", reason="permission bits")


def answering(number: int) -> str:
    return f'__attribute__((visibility("default"))) int answer(void) {{ return {number}; }}\n'


def answer(path: Path) -> int:
    return ctypes.CDLL(str(path)).answer()


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(tmp_path / "cache"))


@pytest.fixture
def builds(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Sources that were compiled, in order."""
    compiled: list[str] = []
    build = Compiler.build

    def noted(self: Compiler, source: str, target: Path, flags: tuple[str, ...]) -> None:
        compiled.append(source)
        build(self, source, target, flags)

    monkeypatch.setattr(Compiler, "build", noted)
    return compiled


def test_a_second_look_compiles_nothing(builds: list[str]) -> None:
    first, second = (library(answering(1), find_compiler()) for _ in range(2))
    assert first == second
    assert len(builds) == 1
    assert answer(first) == 1


def test_another_source_or_compiler_is_another_library(builds: list[str]) -> None:
    gcc = find_compiler()
    other = Compiler(gcc.name, gcc.command, gcc.version + " (another build)")
    paths = {library(answering(1), gcc), library(answering(2), gcc), library(answering(1), other)}
    assert len(paths) == len(builds) == 3


@pytest.mark.parametrize("damage", [b"", b"half a library", None])
def test_a_damaged_file_is_built_again(damage: bytes | None, builds: list[str]) -> None:
    path = library(answering(3), find_compiler())
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] if damage is None else damage)
    assert answer(library(answering(3), find_compiler())) == 3
    assert len(builds) == 2


def test_a_failed_compile_leaves_nothing_behind() -> None:
    with pytest.raises(CompileError):
        library("int answer(void) { return nothing; }\n", find_compiler())
    assert [file.name for file in cache_folder().iterdir()] == [MARKER]


def test_a_killed_compile_is_swept_away_later(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = cache_folder()
    (folder / "unfinished-1-0000dead.so").write_bytes(b"half")
    (folder / "build-deaddead").mkdir()
    (folder / "build-deaddead" / "unit.c").write_text("half")
    path = library(answering(4), find_compiler())
    assert answer(path) == 4
    assert (folder / "build-deaddead").exists()
    monkeypatch.setattr(cache, "ABANDONED_AFTER", -1.0)
    other = library(answering(5), find_compiler())
    assert {file for file in folder.iterdir() if file.name != MARKER} == {path, other}


def left_by_others(number: int, hours: float) -> Path:
    """A library that another process used last so many hours ago."""
    path = library(answering(number), find_compiler())
    cache._used.discard(path)
    then = time.time() - 3600 * hours
    os.utime(path, (then, then))
    return path


def test_libraries_used_longest_ago_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [left_by_others(number, hours) for number, hours in ((6, 3), (7, 5), (8, 1))]
    size = paths[0].stat().st_size
    monkeypatch.setenv("DUALWINCH_CACHE_MB", str(3.5 * size / 1e6))
    newest = library(answering(9), find_compiler())
    assert set(libraries(cache_folder())) == {paths[0], paths[2], newest}


def test_what_nobody_has_used_for_long_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    old, recent = left_by_others(6, 49), left_by_others(7, 47)
    monkeypatch.setenv("DUALWINCH_CACHE_DAYS", "2")
    newest = library(answering(8), find_compiler())
    assert set(libraries(cache_folder())) == {recent, newest}
    assert not old.exists()


def test_hundreds_of_libraries_stay() -> None:
    """One run of the tests, or a comparison of laws and estimators, builds more than 350."""
    path = library(answering(6), find_compiler())
    for number in range(400):
        copy = path.with_name(f"{number:032x}-{path.name[33:]}")
        copy.write_bytes(path.read_bytes())
        copy.chmod(0o700)
    library(answering(7), find_compiler())
    assert len(libraries(cache_folder())) == 402


def test_what_this_process_uses_or_another_one_is_about_to_load_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = library(answering(6), find_compiler()), left_by_others(7, 0)
    os.utime(ours, (1, 1))
    monkeypatch.setenv("DUALWINCH_CACHE_MB", "0")
    monkeypatch.setenv("DUALWINCH_CACHE_DAYS", "1")
    newest = library(answering(8), find_compiler())
    assert set(libraries(cache_folder())) == {ours, theirs, newest}


@pytest.mark.parametrize("name", ["DUALWINCH_CACHE_MB", "DUALWINCH_CACHE_DAYS"])
@pytest.mark.parametrize("value", ["-1", "much", "nan", ""])
def test_a_limit_that_is_none_is_named(name: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, value)
    if not value:
        assert cache_limits() == CacheLimits()
        return
    with pytest.raises(CacheError, match=rf"{name} = '{value}': must be a number >= 0"):
        library(answering(9), find_compiler())


@pytest.mark.slow
def test_two_processes_at_once_both_end_well() -> None:
    program = (
        "import ctypes; from dualwinch.codegen.cache import library\n"
        "from dualwinch.codegen.compiler import find_compiler\n"
        f"print(ctypes.CDLL(str(library({answering(10)!r}, find_compiler()))).answer())"
    )
    running = [subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) for _ in range(4)]
    answers = [process.communicate()[0].strip() for process in running]
    assert answers == ["10"] * 4
    assert answer(library(answering(10), find_compiler())) == 10


def test_a_folder_that_cannot_be_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(tmp_path / "file" / "cache"))
    with pytest.raises(CacheError, match="DUALWINCH_CACHE_DIR"):
        cache_folder()


def test_a_source_is_not_written_again_for_a_recipe(builds: list[str]) -> None:
    written: list[int] = []

    def writing(number: int) -> str:
        written.append(number)
        return answering(number)

    gcc = find_compiler()
    first, again = (library(lambda: writing(11), gcc, (), "eleven") for _ in range(2))
    other = library(lambda: writing(12), gcc, (), "twelve")
    assert first == again != other
    assert written == [11, 12]
    same = library(lambda: writing(11), gcc, (), "eleven, said otherwise")
    assert same == first
    assert library(lambda: writing(11), gcc, ("-DOTHER",), "eleven") != first
    assert written == [11, 12, 11, 11]
    assert len(builds) == 3


def test_threads_that_want_a_recipe_at_once_wait_for_the_first(builds: list[str]) -> None:
    written = list[int]()

    def writing() -> str:
        written.append(21)
        time.sleep(0.1)
        return answering(21)

    with ThreadPoolExecutor(4) as pool:
        found = set(pool.map(lambda _: library(writing, find_compiler(), (), "twenty-one"), range(4)))
    assert len(found) == len(written) == len(builds) == 1
    assert not [file for file in cache_folder().iterdir() if file.suffix == ".lock"]


def test_what_threads_build_side_by_side_takes_its_time_once(
    builds: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "_builds", [(0.0, 10.0), (20.0, 21.0), (5.0, 12.0), (6.0, 7.0)])
    assert cache.build_seconds() == 13.0
    monkeypatch.setattr(cache, "_builds", [])
    began = time.monotonic()
    with ThreadPoolExecutor(4) as pool:
        list(
            pool.map(lambda number: library(f"int f{number}(void) {{ return {number}; }}\n", find_compiler()), range(4))
        )
    assert len(builds) == 4
    assert 0 < cache.build_seconds() <= time.monotonic() - began


def test_a_folder_that_another_process_is_making_is_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other one marks it between the look for the marker and the look whether the folder is empty."""
    listed = Path.iterdir

    def marked_meanwhile(folder: Path) -> Iterator[Path]:
        (folder / MARKER).touch(mode=0o600)
        return iter(list(listed(folder)))

    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(Path, "iterdir", marked_meanwhile)
    assert cache_folder().parent == tmp_path


def test_a_recipe_leads_to_no_library_that_is_gone_or_damaged() -> None:
    first = library(lambda: answering(13), find_compiler(), (), "thirteen")
    first.write_bytes(b"half a library")
    again = library(lambda: answering(13), find_compiler(), (), "thirteen")
    assert answer(again) == 13
    cache._used.discard(again)
    again.unlink()
    library(answering(14), find_compiler())
    assert not [file for file in cache_folder().iterdir() if file.suffix == ".recipe"]


@POSIX
def test_a_recipe_that_others_may_write_to_is_not_used() -> None:
    first = library(lambda: answering(15), find_compiler(), (), "fifteen")
    (note,) = (file for file in cache_folder().iterdir() if file.suffix == ".recipe")
    note.chmod(0o666)
    assert library(lambda: answering(16), find_compiler(), (), "fifteen") != first
