import subprocess
import sys
from pathlib import Path

import pytest

from dualwinch import __version__
from dualwinch.cli import main
from tests.conftest import Refused

SHORT = ["--set", "simulation.duration=0.2"]


@pytest.mark.parametrize("command", [[], ["simulate"], ["export"], ["export", "c"]])
def test_every_command_says_the_version(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    main([*command, "--version"])
    assert capsys.readouterr().out.strip() == __version__


def test_doctor_names_compiler_and_cache(capsys: pytest.CaptureFixture[str]) -> None:
    main(["doctor"])
    said = " ".join(capsys.readouterr().out.split())  # whichever lines are wrapped
    for word in ("C compiler", "cache", "processor", "casadi", "vector instructions", "at most 1000 MB"):
        assert word in said


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_error_says_what_would_help(refused: Refused) -> None:
    words = ("simulate", "--engine", "compiled", "--set", "simulation.substeps=3", *SHORT)
    assert "dualwinch[zig]" in refused(*words, code=1)


@pytest.mark.usefixtures("no_compiler")
@pytest.mark.parametrize(
    "words",
    [
        ("simulate", *SHORT),
        pytest.param(("reproduce", "--cases", "1", "--controllers", "nftsm"), marks=pytest.mark.slow),
    ],
)
def test_without_a_compiler_the_interpreter_runs_and_a_line_says_so(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    main([*words])
    printed = capsys.readouterr()
    assert printed.err.count("no C compiler found, so CasADi's interpreter runs instead") == 1
    assert "--extra zig" in printed.err
    assert "nftsm" in printed.out.lower()


@pytest.mark.usefixtures("no_compiler")
def test_a_compiler_that_was_asked_for_by_name_has_no_substitute(
    refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DUALWINCH_CC", "no-such-compiler")
    assert "no-such-compiler" in refused("simulate", *SHORT, code=1)


def test_a_full_disk_is_one_line_and_leaves_nothing(
    tmp_path: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    error = refused("simulate", "--out", str(tmp_path / "run.csv"), *SHORT, code=1)
    assert "No space left on device" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of sizes there")
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".mat"])
def test_a_file_that_grows_too_large_is_named(suffix: str, tmp_path: Path, refused: Refused) -> None:
    import resource

    file, limits = tmp_path / f"run{suffix}", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        error = refused("simulate", "--out", str(file), *SHORT, code=1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert error.startswith(f"dualwinch: error: {file}: File too large")
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "data.csv", tmp_path / "run.csv"
    link.symlink_to(target)  # a dangling one
    for _ in range(2):
        main(["simulate", "--out", str(link), *SHORT])
        assert link.is_symlink()
        assert target.read_text().startswith("t,x,")
    assert [file.name for file in target.parent.iterdir()] == ["data.csv"]


def test_an_interrupt_before_anything_is_written_says_so(
    tmp_path: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dualwinch.simulation.simulate.simulate", interrupted)
    error = refused("simulate", "--out", str(tmp_path / "run.csv"), code=130)
    assert error == "dualwinch: error: interrupted; nothing was written"


INTERRUPTED = """
import signal
from pathlib import Path

from dualwinch.cli import main


def interrupted(path, target, replace=Path.replace):
    if Path(target).name == "report.html":
        signal.raise_signal(signal.SIGINT)
    return replace(path, target)


signal.signal(signal.SIGINT, signal.default_int_handler)  # even where tests ignore it
Path.replace = interrupted
main({words!r})
"""
"""Interrupted when the report is written, but not yet where it belongs."""


@pytest.mark.slow
def test_an_interrupt_leaves_no_half_written_file(tmp_path: Path) -> None:
    words = ["reproduce", "--cases", "2", "--controllers", "nftsm", "--out", str(tmp_path)]
    program = [sys.executable, "-c", INTERRUPTED.format(words=words)]
    process = subprocess.run(program, stderr=subprocess.PIPE, text=True, check=False)
    error = process.stderr
    assert (tmp_path / "figures" / "figure09.png").exists()
    assert process.returncode == 130
    assert "interrupted; " in error.splitlines()[-1]
    assert " more had been written before, and are complete" in error.splitlines()[-1]
    assert "Traceback" not in error
    assert not list(tmp_path.rglob(".*"))
    assert not (tmp_path / "report.html").exists()
