import subprocess
import sys
from pathlib import Path

import pytest

from dualwinch import __version__
from dualwinch.cli import main

SHORT = ["--set", "simulation.duration=0.2"]


def refused(capsys: pytest.CaptureFixture[str], *words: str, code: int = 2) -> str:
    """The error line of a call that must fail with an exit code and exactly one line."""
    with pytest.raises(SystemExit) as ended:
        main([*words])
    assert ended.value.code == code
    error = capsys.readouterr().err
    assert error.startswith("dualwinch: error: ")
    assert error.count("\n") == 1
    return error


@pytest.mark.parametrize("command", [[], ["simulate"], ["export"], ["export", "c"]])
def test_every_command_says_the_version(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    main([*command, "--version"])
    assert capsys.readouterr().out.strip() == __version__


def test_doctor_names_compiler_and_cache(capsys: pytest.CaptureFixture[str]) -> None:
    main(["doctor"])
    said = " ".join(capsys.readouterr().out.split())  # whichever lines are wrapped
    for word in ("C compiler", "cache", "processor", "casadi", "vector instructions", "at most 1000 MB"):
        assert word in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["simulate", "--case", "5"], "case 5: must be 1, 2, 3 or 4"),
        (["simulate", "--case", "x"], "--case"),
        (["simulate", "--cas", "4"], "Did you mean --case"),
        (["simulat"], "simulate"),
        (["simulate", "--case", "1", "--config", "x.toml"], "one of them"),
        (["simulate", "--config", "missing.toml"], "missing.toml"),
        (["simulate", "--controller", "lqr"], "fando-nftsm"),
        (["simulate", "--controller", "lqi", "--set", "controller.kind=nftsm"], 'given twice, as "lqi" and "nftsm"'),
        (
            ["simulate", "--set", "controller.observer.l0=1", "--set", "controller.observer.l0=2"],
            "given twice, as 1 an",
        ),
        (["simulate", "--set", "plant.vehicle.mas=1"], "did you mean 'plant.vehicle.mass'"),
        (["simulate", "--set", "controller.nftsm.p=4"], "controller.nftsm.p = 4: must be odd"),
        (["simulate", "--set", "controller.nftsm.q=5"], "must be > controller.nftsm.q = 5"),
        (["simulate", "--set", "controller.coordination.preload=300"], "> 400 and < 12000 N"),
        (["simulate", "--set", "reference.speed=3"], "must be <= plant.track.length = 50 m"),
        (["simulate", "--set", "reference.cruise_until=50"], "ascending order"),
        (["simulate", "--set", "simulation.duration=1e-9"], "simulation.duration"),
        (["simulate", "--stride", "0"], "--stride = 0: must be a whole number >= 1"),
        (["simulate", "--stride", "3"], "--stride: needs --out, --plot or --animate"),
        (["simulate", "--out", "run.xls"], ".csv, .parquet, .npz, .mat"),
        (["simulate", "--out", "no/such/folder/run.csv"], "no such folder"),
        (["simulate", "--plot", "run.gif"], ".png, .svg, .pdf"),
        (["export", "c", "--out", ""], "--out: must not be empty"),
        (["export", "c", "--out="], "--out: must not be empty"),
        (["simulate", "--config", ""], "--config: must not be empty"),
        (["simulate", "--ensemble", ""], "--ensemble: must not be empty"),
        (["show", ""], "an argument: must not be empty"),
        (
            ["reproduce", "--cases", "1,7"],
            "unknown case '7'; must be one of 1, 2, 3, 4",
        ),
        (
            ["reproduce", "--controllers", "pid"],
            "unknown controller 'pid'; did you mean 'pid-cascade'?",
        ),
        (["simulate", "--controller", "pid"], "did you mean 'pid-cascade'?"),
        (["sweep", "plant.vehicle.mass=1..20"], "must be first:last:step or first:last:count:log"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refused(capsys, *words)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert "cannot be made" in refused(capsys, "reproduce", "--out", str(tmp_path / "file" / "results"))


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nonexistent/either")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("DUALWINCH_CC", raising=False)
    monkeypatch.setattr("dualwinch.codegen.compiler._zig", lambda: None)


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_error_says_what_would_help(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("simulate", "--engine", "compiled", "--set", "simulation.substeps=3", *SHORT)
    assert "dualwinch[zig]" in refused(capsys, *words, code=1)


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
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DUALWINCH_CC", "no-such-compiler")
    assert "no-such-compiler" in refused(capsys, "simulate", *SHORT, code=1)


def test_a_full_disk_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    error = refused(capsys, "simulate", "--out", str(tmp_path / "run.csv"), *SHORT, code=1)
    assert "No space left on device" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of sizes there")
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".mat"])
def test_a_file_that_grows_too_large_is_named(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import resource

    file, limits = tmp_path / f"run{suffix}", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        error = refused(capsys, "simulate", "--out", str(file), *SHORT, code=1)
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
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dualwinch.simulation.simulate.simulate", interrupted)
    error = refused(capsys, "simulate", "--out", str(tmp_path / "run.csv"), code=1)
    assert error == "dualwinch: error: interrupted; nothing was written\n"


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
    assert process.returncode == 1
    assert "interrupted; " in error.splitlines()[-1]
    assert " more had been written before, and are complete" in error.splitlines()[-1]
    assert "Traceback" not in error
    assert not list(tmp_path.rglob(".*"))
    assert not (tmp_path / "report.html").exists()
