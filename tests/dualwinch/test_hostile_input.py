"""Input that nobody means well: one line, exit code 2, no traceback, nothing left behind."""

import json
import os
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import pytest

from dualwinch.cli import main
from dualwinch.cli.app import PATHS, app
from dualwinch.cli.options import WHOLE
from tests.conftest import Refused

ENDLESS, BEYOND = "9" * 5000, "1" + "0" * 400
"""A whole number of more digits than Python reads, and one beyond every float."""

ENSEMBLE = '[distributions]\n"plant.vehicle.mass" = '


@pytest.mark.parametrize("number", [ENDLESS, BEYOND, f"-{BEYOND}"], ids=["endless", "beyond", "below"])
@pytest.mark.parametrize(
    "key",
    [
        "plant.vehicle.mass",
        "controller.nftsm.p",
        "simulation.substeps",
        "simulation.seed",
        "simulation.delay_samples",
        "sensors.encoder_counts",
        "disturbance.vortex",
        "controller.kind",
        "metrics",
    ],
)
def test_numbers_without_end(key: str, number: str, refused: Refused) -> None:
    assert key in refused("simulate", "--set", f"{key}={number}")
    assert "reference.points" in refused("simulate", "--set", f"reference.points=[{number}, 1]")


@pytest.mark.parametrize(
    "text",
    [
        f"[plant.vehicle]\nmass = {ENDLESS}",
        f"[plant.vehicle]\nmass = {BEYOND}",
        "x = " + "[" * 1000 + "]" * 1000,
        "x = " + "{a = " * 1000 + "1" + "}" * 1000,
        f"[{'.'.join('a' * 1000)}]\nx = 1",
        f"[{'.'.join('a' * 5000)}]\nx = 1",
        f"{'k' * 10000} = 1",
    ],
    ids=["endless", "beyond", "lists", "tables", "dots", "more dots", "long key"],
)
def test_files_without_end(text: str, tmp_path: Path, refused: Refused) -> None:
    file = tmp_path / "f.toml"
    file.write_text(text + "\n")
    assert "f.toml" in refused("simulate", "--config", str(file))
    assert "f.toml" in refused("simulate", "--ensemble", str(file))
    assert "f.toml" in refused("compare", "paper", str(file))


@pytest.mark.parametrize(
    ("value", "outcome"),
    [
        ("plant.vehicle.water_density=1e200", "diverged"),
        ("plant.vehicle.friction_coefficient=1e300", "diverged"),
        ("plant.rope_1.diameter=1e200", "completed"),  # its law depends on the area alone
    ],
)
def test_a_run_of_values_beyond_reason_has_an_outcome(
    value: str, outcome: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["simulate", "--case", "4", "--set", "simulation.duration=2", "--set", value, "--json"])
    assert json.loads(capsys.readouterr().out)["outcome"] == outcome


@pytest.mark.parametrize(
    "entry",
    [
        f"{{ uniform = [1, {BEYOND}] }}",
        f"{{ normal = [1e4, {BEYOND}], within = [1, 2] }}",
        f"{{ normal = [1e4, 1], within = [1, {BEYOND}] }}",
        f"{{ choice = [1e4, {BEYOND}] }}",
        f'{{ kind = "uniform", low = 1, high = {BEYOND} }}',
    ],
)
def test_distributions_beyond_every_float(entry: str, tmp_path: Path, refused: Refused) -> None:
    file = tmp_path / "e.toml"
    file.write_text(f"{ENSEMBLE}{entry}\n")
    assert "plant.vehicle.mass" in refused("simulate", "--ensemble", str(file))


@pytest.mark.parametrize(
    "text",
    [
        "space = 3",
        "[space]\ncontroller = 3",
        "[space]\nlower = 1",
        "[space.controller.nftsm]\nbeta = [1, 2]",
        "[space.controller.nftsm]\nbeta = { lower = 1, upper = [3] }",
        f"[space.controller.nftsm]\nbeta = {{ lower = 1, upper = {BEYOND} }}",
        "[space.controller.nftsm]\nbeta.lower = { x = 3 }",
        '[space.controller.nftsm]\n"p/q" = 3',
        '[space.controller.nftsm]\n"p/q" = true',
        '[space.controller.nftsm]\n"p/q" = [3]',
        f'[space.controller.nftsm]\n"p/q" = ["{"9" * 4400}/3"]',
        '[space.controller.nftsm]\n"p/q" = { a = 1 }',
    ],
)
def test_a_space_of_another_shape(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.toml").write_text(text + "\n")
    assert "space" in refused("tune", "--space", "s.toml", "--case", "4")
    assert [file.name for file in tmp_path.iterdir()] == ["s.toml"]


def commands(parent: Any, name: str = "dualwinch") -> Iterator[tuple[str, Any]]:
    """Every command of the application with its function."""
    if parent.default_command is not None:
        yield name, parent.default_command
    for word in parent:
        if not word.startswith("-"):
            yield from commands(parent[word], f"{name} {word}")


def options_of(function: Any) -> Iterator[tuple[str, Any]]:
    """Every option of a function with its type, those of its groups of options too."""
    for option, hint in get_type_hints(function, include_extras=True).items():
        yield from options_of(hint) if is_dataclass(hint) else [(option, hint)]


def test_every_option_that_is_a_whole_number_is_read_as_one() -> None:
    """Cyclopts would round 1.5."""
    found: dict[str, bool] = {}
    for command, function in commands(app):
        for option, hint in options_of(function):
            kinds = {hint, *get_args(hint), *(inner for part in get_args(hint) for inner in get_args(part))}
            if int in kinds:
                found[f"{command} {option}"] = WHOLE in getattr(hint, "__metadata__", ())
    assert found["dualwinch tune trials"]
    assert [option for option, whole in found.items() if not whole] == []
    assert get_origin(int | None) is not None


def test_no_option_that_is_a_path_may_be_empty() -> None:
    found = set[str]()
    for _, function in commands(app):
        for option, hint in options_of(function):
            if Path in {hint, *get_args(hint), *(inner for part in get_args(hint) for inner in get_args(part))}:
                found.add(option.rstrip("_"))
    positional = {"logs", "run", "file"}
    assert {"out", "config", "plot"} < found <= {*PATHS, *positional}


@pytest.mark.skipif(os.name != "posix", reason="names of files are text there")
def test_names_of_files_that_are_no_text(tmp_path: Path, refused: Refused) -> None:
    name = os.fsdecode(b"\xff\xfe")
    for words in (("simulate", "--out"), ("simulate", "--config"), ("tune", "--out"), ("reproduce", "--out")):
        assert r"\udcff\udcfe.csv': must be UTF-8 text" in refused(*words, str(tmp_path / f"{name}.csv"))
    assert not list(tmp_path.iterdir())


def unforeseen(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str) -> str:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of postgresql://me:hush@host/db?password=hush")

    monkeypatch.setattr("dualwinch.cli.doctor.findings", broken)
    with pytest.raises(SystemExit) as ended:
        main(["doctor", *words])
    assert ended.value.code == 1
    return capsys.readouterr().err


def test_what_nobody_foresaw_is_a_line_and_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    said = unforeseen(capsys, monkeypatch)
    (file,) = tmp_path.iterdir()
    assert said.startswith("dualwinch: error: unforeseen ZeroDivisionError: of postgresql://me:***@host")
    assert said.count("\n") == 1
    assert f"please report it with {file}" in said
    kept = file.read_text()
    assert "Traceback" in kept
    assert "in broken" in kept
    assert "hush" not in said + kept
    assert file.stat().st_mode & 0o077 == 0


def test_a_traceback_is_printed_where_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    said = unforeseen(capsys, monkeypatch, "--traceback")
    assert "Traceback" in said
    assert said.splitlines()[-1].startswith("dualwinch: error: unforeseen ZeroDivisionError")
    assert "hush" not in said
    assert not list(tmp_path.iterdir())
