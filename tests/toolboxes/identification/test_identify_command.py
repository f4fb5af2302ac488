"""The command ``identify``: from a log on disk to a machine that other commands take."""

import json
from pathlib import Path

import pytest

from dualwinch.cli.app import main
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import load
from dualwinch.toolboxes.identification.alternatives import ALTERNATIVES
from tests.conftest import Refused
from tests.toolboxes.identification.conftest import SEA, SENSORS

SET = [word for key, value in SEA.items() for word in ("--set", f"{key}={value}")]
LOG = [word for key, value in SENSORS.items() for word in ("--set", f"{key}={str(value).lower()}")]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("log") / "run.parquet"
    main(["simulate", "--case", "4", *SET, *LOG, "--set", "simulation.duration=10", "--out", str(file)])
    return file


def test_a_machine_and_its_ensemble_come_out(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figure = tmp_path / "fitted.toml", tmp_path / "fit.svg"
    nominal = ["--set", "plant.vehicle.mass=9500", "--set", "simulation.delay_samples=1"]
    words = ["--case", "4", *SET, *nominal, "--hold-out", "20%"]
    main(
        [
            "identify",
            str(log),
            "--fit",
            "plant.vehicle.mass,plant.rope_*.modulus",
            *words,
            "--out",
            str(out),
            "--plot",
            str(figure),
        ]
    )
    said = capsys.readouterr().out
    assert "3 parameters from 9.99" in said or "3 parameters from 10 s" in said
    assert "plant.rope_2.modulus" in said
    assert "held out" in said
    record = json.loads(out.with_suffix(".json").read_text())
    estimate = {each["key"]: each["estimate"] for each in record["parameters"]}
    assert estimate["plant.vehicle.mass"] == pytest.approx(1e4, rel=0.03)
    assert load(out).plant.vehicle.mass == estimate["plant.vehicle.mass"]
    ensemble = load_ensemble(tmp_path / "fitted-ensemble.toml")
    assert set(ensemble.distributions) == set(estimate)
    assert figure.read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fit", "plant.vehicle.mass", "--hold-out", "120%"], "--hold-out 120%: must be 0% to less than 100%"),
        (["--fit", "plant.vehicle.mass", "--prior", "plant.vehicle.mass=9"], "must be KEY=MEAN±DEVIATION"),
        (["--fit", "nothing"], "--fit nothing: no parameter that a log determines"),
        (["--fit", "plant.vehicle.mass", "--out", "fitted.json"], "fitted.json: unknown suffix '.json'; must be .toml"),
        (["--fit", "plant.vehicle.mass", "--column", "F1"], "--column F1: must be READING=COLUMN"),
        (["--fit", "plant.vehicle.mass", "--starts", "0"], "starts = 0: must be a whole number >= 1"),
        (["--fit", "plant.vehicle.mass", "--seed", "-1"], "seed = -1: must be a whole number >= 0"),
        (["--fit", "plant.vehicle.mass", "--prior", "foo=1+-1"], "--prior foo: no parameter that a log determines"),
        (["--fit", "plant.vehicle.mass", "--profile", "foo"], "--profile foo: no parameter that a log determines"),
    ],
)
def test_wrong_words_are_one_line(log: Path, words: list[str], message: str, refused: Refused) -> None:
    assert message in refused("identify", log, *words)


def test_alternatives_are_listed_without_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    main(["identify", "--alternatives", "list"])
    said = capsys.readouterr().out
    assert all(kind in said for kind in ALTERNATIVES)


@pytest.mark.parametrize(
    ("words", "message"),
    [(["--fit", "plant.vehicle.mass"], "give at least one log"), (["run.parquet"], "--fit: give keys to estimate")],
)
def test_a_log_and_keys_are_needed(words: list[str], message: str, refused: Refused) -> None:
    assert message in refused("identify", *words)
