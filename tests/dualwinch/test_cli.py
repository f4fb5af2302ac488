import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dualwinch.cli import main

SHORT = ["--set", "simulation.duration=0.2"]


def dualwinch(*words: str) -> tuple[int, str]:
    """Exit code of a call in this process, and nothing else."""
    try:
        main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0), ""
    return 0, ""


def refused(capsys: pytest.CaptureFixture[str], *words: str, code: int = 2) -> str:
    """The error line of a call that must fail with an exit code and exactly one line."""
    assert dualwinch(*words)[0] == code
    error = capsys.readouterr().err
    assert error.startswith("dualwinch: error: ")
    assert error.count("\n") == 1
    return error


def test_simulate_prints_outcome_and_metrics(capsys: pytest.CaptureFixture[str]) -> None:
    assert dualwinch("simulate", "--case", "4", *SHORT)[0] == 0
    said = capsys.readouterr().out
    assert "completed at 0.2 s" in said
    assert "peak_tension" in said


def test_simulate_writes_data_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "run.csv", tmp_path / "run.png"
    words = ("--controller", "nftsm", "--out", out, "--plot", plot, "--stride", "10", *SHORT)
    assert dualwinch("simulate", *map(str, words))[0] == 0
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t"]) for row in rows][:3] == [0.0, 0.01, 0.02]
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "wrote" in capsys.readouterr().err


def test_both_engines_print_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for engine in ("compiled", "interpreter"):
        assert dualwinch("simulate", "--case", "3", "--engine", engine, *SHORT)[0] == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]


def test_config_is_read_back_by_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert dualwinch("config", "--case", "3", *SHORT)[0] == 0
    file = tmp_path / "case3.toml"
    file.write_text(capsys.readouterr().out)
    assert dualwinch("simulate", "--config", str(file))[0] == 0
    of_file = capsys.readouterr().out
    assert dualwinch("simulate", "--case", "3", *SHORT)[0] == 0
    assert of_file == capsys.readouterr().out


def test_a_run_that_leaves_the_track_is_a_result(capsys: pytest.CaptureFixture[str]) -> None:
    """A soft, undamped position loop swings past the end of the rail."""
    values = {
        "reference.speed": 1.98,
        "plant.vehicle.drag_coefficient": 0,
        "plant.vehicle.friction_coefficient": 0,
        "controller.pid_cascade.kp1": 50,
        "controller.pid_cascade.kp2": 0.02,
    }
    sets = [word for key, value in values.items() for word in ("--set", f"{key}={value}")]
    assert dualwinch("simulate", "--case", "1", "--controller", "pid-cascade", *sets)[0] == 0
    assert "left_track" in capsys.readouterr().out


def test_doctor_names_compiler_and_cache(capsys: pytest.CaptureFixture[str]) -> None:
    assert dualwinch("doctor")[0] == 0
    said = capsys.readouterr().out
    for word in ("C compiler", "cache", "processor", "casadi", "vector instructions"):
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
        (["simulate", "--set", "plant.vehicle.mas=1"], "did you mean 'plant.vehicle.mass'"),
        (["simulate", "--set", "controller.nftsm.p=4"], "controller.nftsm.p = 4: must be odd"),
        (["simulate", "--set", "controller.nftsm.q=5"], "must be > controller.nftsm.q = 5"),
        (["simulate", "--set", "controller.coordination.preload=300"], "> 400 and < 12000 N"),
        (["simulate", "--set", "reference.speed=3"], "must be <= plant.track.length = 50 m"),
        (["simulate", "--set", "reference.cruise_until=50"], "ascending order"),
        (["simulate", "--set", "simulation.duration=1e-9"], "simulation.duration"),
        (["simulate", "--stride", "0"], "--stride = 0: must be a whole number >= 1"),
        (["simulate", "--out", "run.xls"], ".csv, .parquet, .npz, .mat"),
        (["simulate", "--out", "no/such/folder/run.csv"], "no such folder"),
        (["simulate", "--plot", "run.gif"], ".png, .svg, .pdf"),
        (["reproduce", "--cases", "1,7"], "'7' must be one of 1, 2, 3, 4"),
        (["reproduce", "--controllers", "pid"], "'pid' must be one of fando-nftsm"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refused(capsys, *words)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert "cannot be made" in refused(capsys, "reproduce", "--out", str(tmp_path / "file" / "results"))


def test_without_a_compiler_the_error_says_what_would_help(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nonexistent/either")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("DUALWINCH_CC", raising=False)
    monkeypatch.setattr("codegen.compiler._zig", lambda: None)
    words = ("simulate", "--set", "simulation.substeps=3", *SHORT)
    assert "dualwinch[zig]" in refused(capsys, *words, code=1)


def test_a_full_disk_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    error = refused(capsys, "simulate", "--out", str(tmp_path / "run.csv"), *SHORT, code=1)
    assert "No space left on device" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_an_interrupt_leaves_no_half_written_file(tmp_path: Path) -> None:
    words = ["reproduce", "--cases", "2", "--out", str(tmp_path)]
    heeding = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # even where tests ignore it
    program = f"{heeding}; from dualwinch.cli import main; main({words!r})"
    with subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (tmp_path / "figures" / "figure09.png").exists():
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.stderr is not None
        error = process.stderr.read()
    assert process.returncode == 1
    assert "interrupted" in error.splitlines()[-1]
    assert "Traceback" not in error
    assert not list(tmp_path.rglob(".*"))
    assert not (tmp_path / "report.html").exists()


def test_reproduce_writes_what_it_promises(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--cases", "4", "--controllers", "fando-nftsm,nftsm", "--out", str(tmp_path))
    assert dualwinch("reproduce", *words)[0] == 0
    said = capsys.readouterr().out
    assert "−74.4 %" in said
    assert "−93.5 %" in said
    written = {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*") if file.is_file()}
    figures = {f"figures/figure{number}.{suffix}" for number in (17, 18, 19, 20, 21) for suffix in ("png", "svg")}
    data = {f"data/case4-{kind}.parquet" for kind in ("fando-nftsm", "nftsm")}
    assert written == figures | data | {"metrics.json", "report.html"}
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["reductions"]["mae"] == pytest.approx(-0.744, abs=5e-4)
    assert {run["controller"] for run in metrics["runs"]} == {"fando-nftsm", "nftsm"}


def test_reproduce_compares_what_is_beyond_the_paper(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--cases", "4", "--controllers", "nftsm", "--extended", "--out", str(tmp_path))
    assert dualwinch("reproduce", *words)[0] == 0
    said = capsys.readouterr().out
    assert "Beyond the paper" in said
    assert {"super-twisting", "adrc", "master-slave", "force-position"} <= set(said.split())
    extended = json.loads((tmp_path / "metrics.json").read_text())["extended"]
    found = {(run["controller"], run["coordination"]): run["steady_mae"] for run in extended}
    assert len(found) == len(extended) == 7
    assert found["adrc", "differential-tension"] < found["fando-nftsm", "differential-tension"]
    assert found["fando-nftsm", "master-slave"] == pytest.approx(3.7e-3, rel=0.03)
