"""Signals and motions in configuration files: paths, digests, round trips, errors with file and line."""

from pathlib import Path

import pytest

from dualwinch.cli import main
from dualwinch.config.ensemble_file import ensemble_to_toml, load_ensemble
from dualwinch.config.experiment_file import load, to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override

TEXT = '[disturbance.force]\nfile = "data/gust.csv"\nunit = "kN"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "gust.csv").write_text("t,F\n0,0\n1,2\n")
    (tmp_path / "data" / "other.csv").write_text("t,F\n0,0\n1,3\n")
    (tmp_path / "data" / "motion.csv").write_text("t,x\n0,0\n1,0.1\n2,0.5\n")
    (tmp_path / "my.toml").write_text(TEXT)
    return tmp_path


def test_paths_are_relative_to_the_file_that_names_them(folder: Path) -> None:
    force = load(folder / "my.toml").disturbance.force
    assert force.file == str(folder / "data" / "gust.csv")
    assert force.recording is not None
    assert force.recording.columns[0].tolist() == [0, 2]


def test_what_is_printed_is_read_back_from_anywhere(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    values = {
        "reference.kind": "file",
        "reference.file": str(folder / "data" / "motion.csv"),
        "reference.unit": "m",
        "disturbance.current.times": [0, 1.5],
        "disturbance.current.values": [0.1, -0.2],
        "disturbance.current.unit": "kn",
    }
    experiment = override(load(folder / "my.toml"), values)
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "again.toml"
    elsewhere.write_text(to_toml(experiment))
    again = load(elsewhere)
    assert again == experiment
    assert again.reference.digest is not None
    way_points = override(Experiment(), {"reference.kind": "way-points", "reference.points": [20, 5.5]})
    elsewhere.write_text(to_toml(way_points))
    assert load(elsewhere) == way_points


def test_a_changed_file_is_an_error_and_another_one_is_not(folder: Path) -> None:
    kept, gust = folder / "kept.toml", folder / "data" / "gust.csv"
    kept.write_text(to_toml(load(folder / "my.toml")))
    other = {"disturbance.force.file": str(folder / "data" / "other.csv")}
    assert load(kept, settings=other).disturbance.force.digest != load(kept).disturbance.force.digest
    gust.write_text("t,F\n0,0\n1,2.5\n")
    with pytest.raises(ConfigurationError, match=r"kept\.toml:\d+: disturbance\.force: .*gust\.csv: has changed"):
        load(kept)


def test_wrong_files_are_said_of_key_and_line(folder: Path) -> None:
    (folder / "data" / "gust.csv").write_text("t,F\n0,0\n1,nan\n")
    with pytest.raises(ConfigurationError) as caught:
        load(folder / "my.toml")
    message = str(caught.value)
    assert message.startswith(f"{folder / 'my.toml'}:2: disturbance.force: {folder / 'data' / 'gust.csv'}: line 3: F")
    assert "\n" not in message


def test_an_ensemble_draws_among_files(folder: Path) -> None:
    text = TEXT + '[distributions]\n"disturbance.force.file" = { choice = ["data/gust.csv", "data/other.csv"] }\n'
    (folder / "files.toml").write_text(text)
    ensemble = load_ensemble(folder / "files.toml")
    drawn = {scenario.experiment.disturbance.force.digest for scenario in ensemble.scenarios(20, 1)}
    assert len(drawn) == 2
    (folder / "again.toml").write_text(ensemble_to_toml(ensemble))
    assert load_ensemble(folder / "again.toml").distributions == ensemble.distributions
    (folder / "files.toml").write_text(text.replace("other", "none"))
    with pytest.raises(ConfigurationError, match=r"disturbance\.force\.file: .*cannot read .*none\.csv"):
        load_ensemble(folder / "files.toml")


@pytest.mark.parametrize(
    "settings",
    [
        ["disturbance.force.file=data/none.csv"],
        ["disturbance.force.file=data/gust.csv"],
        ["disturbance.force.file=data/gust.csv", "disturbance.force.unit=m"],
        ["reference.kind=file", "reference.file=data/gust.csv", "reference.unit=km"],
    ],
)
def test_the_command_writes_nothing_where_a_file_is_bad(
    settings: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    words = [word for setting in settings for word in ("--set", setting)]
    with pytest.raises(SystemExit) as ended:
        main(["simulate", *words, "--out", "run.csv", "--plot", "run.png"])
    assert ended.value.code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert sorted(folder.rglob("*")) == before
