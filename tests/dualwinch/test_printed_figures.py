"""Every figure that a command prints stands in its machine-readable output."""

import json
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from dualwinch.cli import main
from dualwinch.cli.app import COMMANDS
from dualwinch.toolboxes.stress import cli as stress_command
from dualwinch.toolboxes.stress import stress as stress_module

FACTORS = (1.0, 1e3, 1e6, 1e-3, 100.0)
"""From the SI unit of a file to what is printed: m to mm, m² to mm², J to kJ, shares to %."""

NUMBER = re.compile(r"(?<![\w.^])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?=j?(?![\w^]|\.\d))")


def numbers_in(value: Any) -> Iterator[float]:
    """Every number of plain data, those in names such as ``p95`` too."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from map(float, re.findall(r"\d+", name))
            yield from numbers_in(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from numbers_in(inner)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield float(value)
    elif isinstance(value, str):
        yield from (float(found.replace("−", "-")) for found in NUMBER.findall(value))


def left_out(printed: str, held: Any) -> list[str]:
    """The numbers of a text that are no rounding of a number of a file."""
    known = {factor * number for number in numbers_in(held) for factor in FACTORS}
    missing = []
    for word in NUMBER.findall(printed):
        text = word.replace("−", "-")
        digits, _, exponent = text.partition("e")
        half = 0.5000001 * 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
        if not any(abs(abs(number) - abs(float(text))) <= max(half, 1e-9 * abs(number)) for number in known):
            missing.append(word)
    return missing


UNIT = re.compile(r'"units?": ')
"""Name under which a file has units."""

WITHOUT_UNITS = {"doctor"}
"""Commands whose JSON has no quantity."""

BULK = ("curves", "configuration", "versions", "trials", "fronts", "experiment", "base_configuration")
"""Entries of files with so many numbers that any printed one would be found among them."""

SHORT = ("--set", "simulation.duration=2")

FEW_IMPERFECTIONS = """
[distributions]
sensors.position_bias = { uniform = [-2e-3, 2e-3] }
plant.winch_1.torque_ripple = { uniform = [0, 0.01] }
actuator.motor.time_constant = { kind = "log-uniform", low = 2e-4, high = 8e-3 }

[actuator]
kind = "motor"

[simulation]
jitter = 50e-6
"""
"""One on both sides of zero, one on one side, a kind of part and a single value, each as in the rig."""

FOLDERS = {"tune", "race", "reproduce"}
"""Commands that write a folder, which has machine-readable files."""

TO_FILES = [
    ["linearise", "--x", "20", "--v", "1"],
    ["linearise", "--sweep", "x=10:40:10"],
    ["linearise", "--loop", "closed", "--v", "0.5"],
    ["linearise", "--loop", "closed", "--sweep", "preload=1000:3000:1000"],
    ["linearise", "--loop", "open", "--v", "0.5"],
    ["linearise", "--loop", "open", "--sweep", "x=10:40:15"],
    ["linearise", "--ensemble", "rig", "--loop", "open", "--v", "0.5"],
    ["certify", "--case", "4", *SHORT],
    ["preload", "--case", "4", *SHORT],
    ["compare", "paper", "--scenarios", "4", *SHORT],
    ["tune", "--case", "4", "--set", "simulation.duration=0.1", "--trials", "20"],
    pytest.param(
        ["tune", "--ensemble", "sea", *SHORT[:1], "simulation.duration=0.1", "--scenarios", "2", "--trials", "40"],
        marks=pytest.mark.slow,
    ),
    pytest.param(
        [
            *("tune", "--ensemble", "sea", *SHORT[:1], "simulation.duration=0.1", "--scenarios", "2", "--trials", "40"),
            *("--constraint", "none", "--stress"),
        ],
        marks=pytest.mark.slow,
    ),
    pytest.param(
        [
            *("race", "--ensemble", "sea", *SHORT[:1], "simulation.duration=0.1", "--scenarios", "2"),
            *("--law", "nftsm", "--law", "adrc", "--rollouts", "60", "--test-scenarios", "4"),
        ],
        marks=pytest.mark.slow,
    ),
    pytest.param(
        ["reproduce", "--cases", "4", "--controllers", "fando-nftsm,nftsm", "--extended"], marks=pytest.mark.slow
    ),
]

AS_JSON = [
    ["simulate", "--case", "4", *SHORT],
    ["simulate", "--ensemble", "sea", "--scenarios", "4", *SHORT],
    ["simulate", "--ensemble", "sea", "--scenarios", "4", "--statistics-only", *SHORT],
    ["sensitivities", "plant.vehicle.mass", "sensors.position_bias", "--case", "4", "--column", "F1", *SHORT],
    ["sweep", "controller.observer.l0=5:15:5", "--case", "4", "--metric", "mae", *SHORT],
    ["sweep", "controller.observer.l0=5,10", "plant.vehicle.mass=9e3,1e4", "--case", "4", *SHORT],
    pytest.param(
        ["identify", "log.parquet", "--fit", "plant.vehicle.mass", "--case", "4", "--hold-out", "20%"],
        marks=pytest.mark.slow,
    ),
    pytest.param(
        [
            *("identify", "log.parquet", "--fit", "plant.vehicle.mass", "--case", "4"),
            *("--starts", "2", "--profile", "plant.vehicle.mass"),
        ],
        marks=[pytest.mark.slow, pytest.mark.nightly],
    ),
    [
        *("excite", "--fit", "plant.vehicle.mass", "--case", "4", "--set", "sensors.tension_noise=10"),
        *("--duration", "10s", "--trials", "4"),
    ],
    [
        *("stress", "--case", "4", "--ensemble", "drums.toml", "--base", "none", "--scenarios", "2"),
        *("--set", "simulation.duration=0.5"),
    ],
    ["doctor"],
]

WITHOUT = {"lab", "show", "config", "export"}
"""Commands that print no figures: they write pages, code and configurations."""

ELSEWHERE = {"serve"}
"""Commands that need a client, or another process, for this: tests/dualwinch/commands has it."""


def words_of(case: Any) -> list[str]:
    """The words of a case, with marks or without."""
    return case if isinstance(case, list) else case.values[0]


def without_bulk(table: dict[str, Any]) -> dict[str, Any]:
    """A table of a file without curves and texts."""
    return {key: value for key, value in table.items() if key not in BULK}


def named(words: list[str]) -> str:
    """What a case is called."""
    return " ".join(words[:4])


@pytest.fixture(autouse=True)
def few_imperfections(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains are stressed by imperfections of each kind of size: each by itself has compiled code of its own."""
    file = tmp_path / "few.toml"
    file.write_text(FEW_IMPERFECTIONS)
    monkeypatch.setattr(stress_module, "STRESS_ENSEMBLE", file)
    monkeypatch.setattr(stress_command, "stress", partial(stress_command.stress, ensemble=str(file)))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory, so that printed paths have no numbers."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("words", TO_FILES, ids=named)
def test_every_figure_printed_is_in_the_file(
    words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = Path("out" if words[0] in FOLDERS else "out.json")
    main([*words, "--out", str(out)])
    files = sorted((folder / out).glob("*.json")) if words[0] in FOLDERS else [folder / out]
    held = [json.loads(file.read_text(), object_hook=without_bulk) for file in files]
    assert not left_out(capsys.readouterr().out, held)
    assert all(UNIT.search(json.dumps(each)) for each in held), "a file says the units of its figures"


@pytest.mark.parametrize("words", AS_JSON, ids=named)
def test_every_figure_of_a_table_is_in_the_json(
    words: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if words[0] == "doctor":  # says how many libraries the cache has, to which other workers add
        monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(folder / "cache"))
        main(words)
        capsys.readouterr()
    (folder / "drums.toml").write_text("[distributions]\nplant.winch_1.radius_error = { uniform = [-2e-3, 2e-3] }\n")
    if "log.parquet" in words:
        main(["simulate", "--case", "4", *SHORT, "--set", "simulation.readings=true", "--out", "log.parquet"])
        capsys.readouterr()
    main(words)
    printed = capsys.readouterr().out
    main([*words, "--json"])
    held = json.loads(capsys.readouterr().out, object_hook=without_bulk)
    assert not left_out(printed, held)
    assert UNIT.search(json.dumps(held)) or words[0] in WITHOUT_UNITS, "JSON says the units of its figures"


def test_every_command_that_prints_figures_is_here() -> None:
    here = {words_of(case)[0] for case in TO_FILES + AS_JSON}
    assert here | WITHOUT | ELSEWHERE == set(COMMANDS)


def test_a_number_that_is_left_out_is_found() -> None:
    assert left_out("gain 12.3 at 4.56 Hz, 78 %", {"gain": 12.34, "share": 0.78}) == ["4.56"]
