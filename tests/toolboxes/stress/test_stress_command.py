"""``dualwinch stress`` as a user runs it, with half a second of simulated time."""

import json
import re
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.config.ensemble_file import load_ensemble, loads_ensemble
from dualwinch.config.experiment_file import load, to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.stress import cli as stress_command
from dualwinch.toolboxes.stress import stress as stress_module
from dualwinch.toolboxes.stress.cli import replaced, study_constraints
from dualwinch.toolboxes.stress.stress import base_and_ensemble
from tests.conftest import Refused
from tests.killed import killed_after, written
from tests.toolboxes.stress.ensembles import DRUMS, short

SHORT = ("--set", "simulation.duration=0.5", "--scenarios", "2")


@pytest.fixture
def drums(tmp_path: Path) -> Path:
    path = tmp_path / "drums.toml"
    path.write_text(DRUMS + "[sensors]\nspeed_noise = 0.1\n[plant.creep_1]\nelongation = 1e-3\n")
    return path


@pytest.fixture
def gains(tmp_path: Path) -> Path:
    path = tmp_path / "best.toml"
    path.write_text('[controller]\nestimator = "kalman"\nobserver.l0 = 9.0\n')
    return path


def study(folder: Path, settings: dict[str, float]) -> None:
    constraints = [
        {"text": "worst.peak_tension<=5000", "bound": 5000.0},
        {"text": "mean.chatter<=1*paper", "bound": 40.5},
    ]
    (folder / "study.json").write_text(json.dumps({"best": {"settings": settings}, "constraints": constraints}))


def test_stress_prints_a_table_and_writes_json_and_figure(
    drums: Path, gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "stress"
    main(["stress", str(gains), "--ensemble", str(drums), "--base", "none", *SHORT, "--seed", "4", "--out", str(out)])
    said = capsys.readouterr()
    assert "Stress: imperfections of 'drums' on top of 'none', 2 scenarios, seed 4" in said.out
    assert "| winch drum radius | ±0.2 %" in said.out
    assert "best.toml breaks at" in said.out
    assert said.err.splitlines()[-2:] == [f"wrote {out / 'stress.json'}", f"wrote {out / 'stress.svg'}"]
    facts = json.loads((out / "stress.json").read_text())
    assert (facts["ensemble"], facts["base"], facts["scenarios"], facts["seed"]) == ("drums", "none", 2, 4)
    assert [each["name"] for each in facts["gains"]] == ["paper", "best.toml"]
    assert facts["gains"][1]["controller"]["observer.l0"] == 9.0
    assert {row["label"] for row in facts["imperfections"]} == {
        "winch drum radius",
        "speed noise",
        "creep elongation",
        "all together",
    }
    again = loads_ensemble(facts["configuration"])
    assert "plant.winch_1.drum_radius" in again.distributions
    assert (out / "stress.svg").read_text().startswith("<?xml")


def test_python_gives_what_the_command_prints(drums: Path, gains: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["stress", str(gains), "--ensemble", str(drums), "--base", "none", *SHORT])
    printed = capsys.readouterr().out
    found = dw.stress(
        load(gains, settings={"simulation.duration": 0.5}), ensemble=drums, base=None, scenarios=2, name="best.toml"
    )
    assert printed == f"{found!r}\n"
    drawn = dw.load_ensemble(drums, short())
    with pytest.raises(ConfigurationError, match="name = paper: stands for the paper's gains"):
        dw.stress(load(gains), ensemble=drawn, base=None, name="paper")


@pytest.mark.slow
def test_a_killed_stress_test_goes_on_to_the_same_digits(drums: Path, gains: Path, tmp_path: Path) -> None:
    words = ["stress", str(gains), "--ensemble", str(drums), "--base", "none", *SHORT, "--out"]
    kept = tmp_path / "kept"
    files = killed_after(3, [*words, str(tmp_path / "there"), "--checkpoint", str(kept)], kept)
    main([*words, str(tmp_path / "there"), "--checkpoint", str(kept)])
    assert files.items() <= written(kept).items()
    assert len(files) < len(written(kept))
    main([*words, str(tmp_path / "here")])
    assert (tmp_path / "there" / "stress.json").read_bytes() == (tmp_path / "here" / "stress.json").read_bytes()


def test_after_an_interrupt_the_same_call_goes_on(
    drums: Path, gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, run_grid, sizes = tmp_path / "stress", stress_module.batches.run_grid, list[int]()

    def interrupted(*words: Any, **options: Any) -> Any:
        if len(sizes) == 3:
            raise KeyboardInterrupt
        sizes.append(len(words[0]))
        return run_grid(*words, **options)

    words = ["stress", str(gains), "--ensemble", str(drums), "--base", "none", *SHORT, "--out", str(out)]
    with monkeypatch.context() as patched:
        patched.setattr(stress_module.batches, "run_grid", interrupted)
        with pytest.raises(SystemExit) as ended:
            main(words)
    assert ended.value.code == 130
    portions = written(out / stress_command.UNFINISHED)
    assert portions
    assert f"{out / stress_command.UNFINISHED}; the same call goes on" in capsys.readouterr().err
    main(words)
    assert {file.name for file in out.iterdir()} == {"stress.json", "stress.svg"}


def test_constraints_come_from_the_study_beside_its_best_gains(gains: Path, tmp_path: Path) -> None:
    assert study_constraints(gains, load(gains)) == {}
    study(tmp_path, {"controller.observer.l0": 9.0})
    assert study_constraints(gains, load(gains)) == {"worst.peak_tension<=5000": 5000.0, "mean.chatter<=1*paper": 40.5}
    study(tmp_path, {"controller.observer.l0": 9.5})
    assert study_constraints(gains, load(gains)) == {}
    (tmp_path / "study.json").write_text("[]")
    assert study_constraints(gains, load(gains)) == {}


def test_a_report_beside_the_results_shows_them_once(drums: Path, gains: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text("<h1>Tuned</h1>\n<!-- stress: begin -->\n<!-- stress: end -->\n<h2>The gains</h2>\n")
    words = ["stress", str(gains), "--ensemble", str(drums), "--base", "none", *SHORT, "--out", str(tmp_path)]
    for seed in ("1", "2"):
        main([*words, "--seed", seed])
    page = report.read_text()
    assert page.count("<h2>Robustness margins") == 1
    assert "seed 2</small>" in page
    assert page.count("data:image/png;base64,") == 1
    assert page.startswith("<h1>Tuned</h1>")
    assert page.endswith("<!-- stress: end -->\n<h2>The gains</h2>\n")
    report.write_text("<h1>Another report</h1>\n")
    main(words)
    assert report.read_text() == "<h1>Another report</h1>\n"


@pytest.mark.slow
def test_tune_finds_out_what_breaks_its_best_first(
    drums: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stress_module, "STRESS_ENSEMBLE", drums)
    few = partial(stress_command.stress, ensemble=str(drums), scenarios=2)
    monkeypatch.setattr(stress_command, "stress", few)
    out = tmp_path / "tuned"
    main(["tune", "--case", "2", "--set", "simulation.duration=0.2", "--trials", "3", "--stress", "--out", str(out)])
    said = capsys.readouterr()
    assert "Stress: imperfections of 'drums' on top of 'none', 2 scenarios, seed 0" in said.out
    assert "Must hold: every run completed; worst.min_tension >= 80 N; " in said.out
    assert all(f"wrote {out / name}" in said.err for name in ("stress.json", "stress.svg", "report.html"))
    assert "Not tested yet" not in (out / "report.html").read_text()
    assert "<h2>Robustness margins" in (out / "report.html").read_text()
    main(["tune", "--case", "2", "--set", "simulation.duration=0.2", "--trials", "3", "--out", str(tmp_path / "again")])
    assert "Not tested yet" in (tmp_path / "again" / "report.html").read_text()


def test_tune_says_at_once_that_there_is_nothing_to_break(
    drums: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stress_module, "STRESS_ENSEMBLE", drums)
    with pytest.raises(SystemExit):
        main(["tune", "--ensemble", str(drums), "--trials", "3", "--stress", "--out", str(tmp_path / "tuned")])
    assert "--stress: ensemble 'drums': has no imperfection that its base 'drums' lacks" in capsys.readouterr().err
    assert not (tmp_path / "tuned").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give one of a file, such as best.toml of `dualwinch tune`, and --case"),
        (("best.toml", "--case", "4"), "give one of a file"),
        (("nowhere.toml",), "cannot read nowhere.toml"),
        (("--case", "7"), "case 7: must be 1, 2, 3 or 4"),
        (("--case", "4", "--ensemble", "rigg"), "did you mean 'rig'"),
        (("--case", "4", "--base", "rig"), "has no imperfection that its base 'rig' lacks"),
        (("--case", "4", "--scenarios", "0"), "scenarios = 0: must be a whole number >= 1"),
        (("--case", "4", "--seed", "-1"), "seed = -1: must be a whole number >= 0"),
        (("--case", "4", "--constraint", "worst.peak<=1"), "unknown metric 'peak'; did you mean 'peak_tension'"),
        (("--case", "4", "--set", "plant.vehicle.mas=1"), "did you mean 'plant.vehicle.mass'"),
        (("--case", "4", "--set", "disturbance.strouhal=0.1"), "disturbance.strouhal: is drawn in the ensemble 'sea'"),
    ],
)
def test_wrong_input_is_one_line(
    words: tuple[str, ...], message: str, refused: Refused, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in refused("stress", *words)


def test_what_gains_have_of_the_ensemble_they_were_tuned_in_comes_off_first() -> None:
    sea, rig = load_ensemble("sea"), load_ensemble("rig")
    kind, harsh = base_and_ensemble(rig.experiment, "rig", "sea")
    assert kind.experiment == sea.experiment
    assert harsh.experiment == rig.experiment
    heavier = override(rig.experiment, {"plant.vehicle.mass": 1.2e4})
    assert base_and_ensemble(heavier, "rig", "sea")[0].experiment.plant.vehicle.mass == 1.2e4


def test_an_ensemble_is_read_on_the_machine_of_the_gains(tmp_path: Path) -> None:
    rollers = tmp_path / "rollers.toml"
    rollers.write_text(
        "[sensors]\nspeed_noise = 0.1\n[distributions]\nplant.track.roller_spacing = { uniform = [2.0, 4.0] }\n"
    )
    gains = override(Experiment(), {"plant.track.roller_spacing": 3.0, "sensors.speed_noise": 0.1})
    kind, harsh = base_and_ensemble(gains, rollers, None)
    assert kind.experiment.sensors.speed_noise == 0.0
    assert harsh.experiment.sensors.speed_noise == 0.1
    assert harsh.experiment.plant.track.roller_spacing == 3.0


def test_values_of_the_file_that_the_base_sets_itself_are_said(
    tmp_path: Path, drums: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[sensors]\ntension_noise = 15.0\nposition_resolution = 0.002\nencoder_counts = 0\n")
    drums.write_text(DRUMS)
    main(["stress", str(mine), "--ensemble", str(drums), "--base", "sea", *SHORT, "--set", "sensors.encoder_counts=1"])
    said = capsys.readouterr().err
    assert (
        "note: the base 'sea' sets values of its own: sensors.position_resolution = 0.001 (the file: 0.002), "
        "sensors.tension_noise = 10.0 (the file: 15.0); to judge the gains with those of "
        f"{mine}: --base none, or edit a copy of the base (dualwinch config --ensemble sea > my.toml)\n"
    ) in said
    mine.write_text(to_toml(load(mine)))
    said = replaced(mine, "sea", load_ensemble("sea", load(mine)))
    assert "sensors.tension_noise = 10.0 (the file: 15.0), " in said
    assert re.search(r", and \d+ more; to judge", said)
    mine.write_text(to_toml(load_ensemble("sea").experiment))
    assert not replaced(mine, "sea", load_ensemble("sea", load(mine)))
