import csv
import json
import re
import shlex
from pathlib import Path

import pytest

from dualwinch.cli import main

SHORT = ["--set", "simulation.duration=0.2"]


def test_simulate_prints_outcome_and_metrics(capsys: pytest.CaptureFixture[str]) -> None:
    main(["simulate", "--case", "4", *SHORT])
    said = capsys.readouterr().out
    assert "completed at 0.2 s" in said
    assert "peak_tension" in said


def test_simulate_writes_data_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "run.csv", tmp_path / "run.png"
    words = ("--controller", "nftsm", "--out", out, "--plot", plot, "--stride", "10", *SHORT)
    main(["simulate", *map(str, words)])
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t"]) for row in rows][:3] == [0.0, 0.01, 0.02]
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "wrote" in capsys.readouterr().err


def test_config_is_read_back_by_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["config", "--case", "3", *SHORT])
    file = tmp_path / "case3.toml"
    file.write_text(capsys.readouterr().out)
    main(["simulate", "--config", str(file)])
    of_file = capsys.readouterr().out
    main(["simulate", "--case", "3", *SHORT])
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
    main(["simulate", "--case", "1", "--controller", "pid-cascade", *sets])
    said = capsys.readouterr().out
    assert "left_track" in said
    assert all(" – " in line for line in said.splitlines() if line.startswith(("mse", "mae", "peak_tension", "energy")))


def test_an_ensemble_is_remarked_on_like_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "--ensemble", "site", "--scenarios", "2", *SHORT]
    main(words)
    said = capsys.readouterr().out
    assert "note: unstable at small amplitudes" in said
    assert "dualwinch linearise --set simulation.duration=0.2 --ensemble site --loop closed --x 25" in said
    main([*words, "--json"])
    remarks = json.loads(capsys.readouterr().out)["remarks"]
    assert all(f"note: {remark}" in said for remark in remarks)
    assert remarks


@pytest.mark.parametrize("option", [(), ("--statistics-only",)])
def test_statistics_of_an_ensemble_say_how_many_scenarios_they_are_of(
    option: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the larger gain the vehicle swings past the end of the rail."""
    file = tmp_path / "soft.toml"
    file.write_text(
        '[ensemble]\nname = "soft"\n[distributions]\ncontroller.pid_cascade.kp1 = { choice = [5, 50] }\n'
        '[controller]\nkind = "pid-cascade"\n[reference]\nspeed = 1.98\n'
        "[plant.vehicle]\ndrag_coefficient = 0\nfriction_coefficient = 0\n"
    )
    words = ["simulate", "--case", "1", "--ensemble", str(file), "--scenarios", "6", "--seed", "1", *option]
    main(words)
    printed = capsys.readouterr().out
    main([*words, "--json"])
    counts = json.loads(capsys.readouterr().out)["outcomes"]
    assert counts == {"completed": 4, "left_track": 2}
    assert "Statistics are those of the 4 of 6 scenarios that were completed.\n" in printed
    main(["simulate", "--ensemble", "sea", "--scenarios", "3", *SHORT, *option])
    assert "Statistics are those" not in capsys.readouterr().out


def test_the_command_in_a_note_is_about_the_experiment_at_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "my machine.toml"
    file.write_text("[controller.observer]\nl0 = 3000.0\n[simulation]\nduration = 1.0\n")
    main(["simulate", "--config", str(file), "--set", "plant.vehicle.mass=9000"])
    printed = capsys.readouterr().out
    (command,) = set(re.findall(r"unstable at small amplitudes.*\((dualwinch linearise [^)]*)\)", printed))
    assert shlex.split(command)[2:6] == ["--config", str(file), "--set", "plant.vehicle.mass=9000"]
    main(shlex.split(command)[1:])
    assert "unstable" in capsys.readouterr().out


def test_a_machine_that_nothing_describes_is_said_to_be_the_papers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn, empty = tmp_path / "drawn.toml", tmp_path / "empty.toml"
    drawn.write_text('[distributions]\nplant.vehicle.mass = { uniform = [0.9, 1.1], of = "nominal" }\n')
    empty.write_text("# nothing yet\n")
    machine = "gives no value of the plant, so that the machine is the paper's: 10 t on 50 m; --config FILE gives anoth"
    words = ["simulate", "--scenarios", "2", *SHORT, "--ensemble"]

    def said(*more: str) -> str:
        main([*words, *more])
        return capsys.readouterr().err

    assert f"note: {drawn}: {machine}" in said(str(drawn))
    assert machine not in said(str(drawn), "--case", "4")
    assert machine not in said(str(drawn), "--set", "plant.vehicle.mass=9e3")
    assert "note:" not in said("sea")
    nothing = said(str(empty))
    assert machine in nothing
    assert "note: the ensemble 'empty': it has no [distributions], so no value is drawn, and scenarios" in nothing
    everything = f"note: {empty}: gives no key, so that everything is the default, the paper's machine\n"
    assert said(str(drawn), "--config", str(empty)).count(everything) == 1
    main(["simulate", "--config", str(empty), *SHORT])
    assert capsys.readouterr().err == everything
    main(["simulate", "--config", str(empty), *SHORT, "--json"])
    printed = capsys.readouterr()
    assert printed.err == everything
    assert [f"note: {words}\n" for words in json.loads(printed.out)["notes"]] == [everything]
