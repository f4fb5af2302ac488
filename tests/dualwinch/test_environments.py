"""Computers other than ours: closed streams, other encodings, no home, no symbolic links, full disks."""

import errno
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.codegen import cache
from dualwinch.codegen.errors import CacheWarning
from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.storage.journal import ResumableJournal

ROOT = Path(__file__).parents[2]
SHORT = {"simulation.duration": 0.1}


def command(*words: str, folder: Path, before: str = "", **environment: str) -> "subprocess.CompletedProcess[bytes]":
    """The command line in a process of its own."""
    run = f"{before}from dualwinch.cli import main; main({list(words)!r})"
    return subprocess.run(
        [sys.executable, "-c", run], cwd=folder, env=os.environ | environment, capture_output=True, check=False
    )


@pytest.mark.slow
def test_with_closed_streams_the_work_is_done(tmp_path: Path) -> None:
    closed = "import sys; sys.stdout = sys.stderr = None; import os; os.close(1); os.close(2);"
    done = command("simulate", "--set", "simulation.duration=0.1", "--out", "run.csv", folder=tmp_path, before=closed)
    assert done.returncode == 0
    assert dw.load_result(tmp_path / "run.csv").outcome == "completed"


def test_what_goes_to_a_file_is_utf_8_whatever_the_terminal_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    file = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(file, "latin-1"))
    with pytest.raises(SystemExit):
        main(["simulate", "--set", "controller.kind=Größe"])
    sys.stdout.write("Größe\n")
    sys.stdout.flush()
    assert file.getvalue().decode("utf-8") == "Größe\n"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_a_file_as_editors_and_powershell_write_it_is_read(encoding: str, tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_bytes("# Größe\r\n[plant.vehicle]\r\nmass = 9e3\r\n".encode(encoding))
    assert dw.load(file).plant.vehicle.mass == 9e3


def test_another_encoding_is_refused_with_the_byte_and_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_bytes("# Größe".encode("latin-1"))
    with pytest.raises(ConfigurationError, match=r"not UTF-8 text \(byte 4: 0xf6\); save it as UTF-8"):
        dw.load(tmp_path / "my.toml")


@pytest.mark.skipif(sys.platform != "linux", reason="paths of any bytes are Linux's")
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".mat"])
def test_a_result_is_saved_and_loaded_under_a_path_that_is_no_utf_8(suffix: str, tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"Gr\xf6\xdfe")
    folder.mkdir()
    result = dw.simulate(dw.override(dw.case(2), SHORT))
    dw.save(result, folder / f"run{suffix}")
    assert (dw.load_result(folder / f"run{suffix}")["x"] == result["x"]).all()


def test_without_a_home_libraries_are_kept_for_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless(*_: object) -> Path:
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("DUALWINCH_CACHE_DIR", raising=False)
    monkeypatch.setattr(cache, "user_cache_path", homeless)
    with pytest.warns(CacheWarning, match="not kept: could not determine the home directory"):
        assert cache.cache_folder().is_dir()


def test_where_nothing_may_be_run_from_the_temporary_folder_another_is_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    useless = cache._useless
    monkeypatch.setattr(
        cache, "_useless", lambda folder: useless(folder) if folder.is_relative_to(tmp_path) else "noexec"
    )
    monkeypatch.setattr(cache, "PARENTS", (str(tmp_path),))
    with pytest.warns(CacheWarning, match="not kept: no reason"):
        assert cache._substitute("no reason").parent == tmp_path


def test_a_checkout_without_links_finds_its_packages_beside_itself(tmp_path: Path) -> None:
    (tmp_path / "dualwinch").mkdir()
    for name in ("__init__.py", "__init__.pyi"):
        shutil.copy(ROOT / "dualwinch" / name, tmp_path / "dualwinch")
    for name in ("model", "codegen"):
        (tmp_path / "dualwinch" / name).write_text(f"../{name}")  # what Git checks out in place of a link
        shutil.copytree(ROOT / name, tmp_path / name)
    run = "from dualwinch.model import units; print(units.__file__)"
    found = subprocess.run([sys.executable, "-c", run], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert Path(found.stdout.strip()) == tmp_path / "model" / "units.py"


def test_a_full_disk_under_a_journal_names_it_and_the_way_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    journal = ResumableJournal(str(tmp_path / "study.journal"))
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match=r"No space left.* --resume continues with them: '.*study\.journal'"):
        journal.append_logs([{}])


@pytest.mark.slow
def test_a_reader_that_ends_early_is_no_error(tmp_path: Path) -> None:
    broken = "import os, sys; r, w = os.pipe(); os.close(r); os.dup2(w, 1);"
    for words in (["config"], ["--help"]):
        done = command(*words, folder=tmp_path, before=broken)
        assert (done.returncode, done.stderr) == (0, b"")
