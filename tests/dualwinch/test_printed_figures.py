"""Every figure that a command prints stands in its machine-readable output."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dualwinch.cli import main

FACTORS = (1.0, 1e3, 1e6, 1e-3, 100.0)
"""From the SI unit of a file to what is printed: m to mm, m² to mm², J to kJ, shares to %."""

NUMBER = re.compile(r"(?<![\w.^])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?=j?(?![\w^]|\.\d))")


def numbers_in(value: Any) -> Iterator[float]:
    """Every number of plain data."""
    if isinstance(value, dict):
        for inner in value.values():
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


BULK = ("curves", "configuration", "versions")
"""Entries of files with so many numbers that anything that is printed would be found among them."""

SHORT = ("--set", "simulation.duration=2")

COMMANDS = [
    ["linearise", "--x", "20", "--v", "1"],
    ["linearise", "--sweep", "x=10:40:10"],
    ["linearise", "--loop", "closed", "--v", "0.5"],
    ["linearise", "--loop", "closed", "--sweep", "preload=1000:3000:1000"],
    ["linearise", "--loop", "broken", "--v", "0.5"],
    ["linearise", "--loop", "broken", "--sweep", "x=10:40:15"],
    ["certify", "--case", "4", *SHORT],
    ["preload", "--case", "4", *SHORT],
    ["compare", "paper", "--scenarios", "4", *SHORT],
]


def without_bulk(table: dict[str, Any]) -> dict[str, Any]:
    """A table of a file without curves and texts."""
    return {key: value for key, value in table.items() if key not in BULK}


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: " ".join(words[:4]))
def test_every_figure_printed_is_in_the_file(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.json"
    main([*words, "--out", str(out)])
    held = json.loads(out.read_text(), object_hook=without_bulk)
    assert not left_out(capsys.readouterr().out, held)


def test_a_number_that_is_left_out_is_found() -> None:
    assert left_out("gain 12.3 at 4.56 Hz, 78 %", {"gain": 12.34, "share": 0.78}) == ["4.56"]


JSON_COMMANDS = [
    ["sensitivities", "plant.vehicle.mass", "sensors.position_bias", "--case", "4", "--column", "F1", *SHORT],
    ["sweep", "controller.observer.l0=5:15:5", "--case", "4", "--metric", "mae", *SHORT],
    ["sweep", "controller.observer.l0=5,10", "plant.vehicle.mass=9e3,1e4", "--case", "4", *SHORT],
]


@pytest.mark.parametrize("words", JSON_COMMANDS, ids=lambda words: " ".join(words[:2]))
def test_every_figure_of_a_table_is_in_the_json(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    main(words)
    printed = capsys.readouterr().out
    main([*words, "--json"])
    assert not left_out(printed, json.loads(capsys.readouterr().out))
