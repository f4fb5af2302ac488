"""Numbers that are allowed and that nobody would give: runs that diverge are results, and every file is whole."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.config.experiment_file import experiment_from, to_toml
from dualwinch.config.toml_text import flattened
from tests.attack.call import SLOW, call

EXAMPLES = 12

KEYS = [
    key
    for key, value in flattened(tomllib.loads(to_toml(experiment_from(4, None, None, []))))
    if isinstance(value, float) and key.partition(".")[0] in {"plant", "controller", "disturbance", "sensors"}
]
"""Every key that is a number and no part of the compiled code, nor of how long it runs."""

NUMBERS = [0.0, -0.0, 1e-300, 1e-9, 1e-3, 0.5, 1.0, 10.0, 1e3, 1e6, 1e12, 1e100, 1e300, -1e-9, -1.0, -1e6, -1e300]

COMMANDS = [
    *(("simulate", "--out", f"o.{suffix}") for suffix in ("csv", "parquet", "npz", "mat")),
    ("simulate", "--plot", "o.svg"),
    ("simulate", "--engine", "interpreter"),
    ("linearise", "--out", "o.json"),
    ("linearise", "--loop", "open", "--out", "o.json"),
    ("certify", "--out", "o.json"),
    ("sweep", "controller.coordination.preload=1000:4000:1000", "--out", "o.csv"),
    ("export", "c", "--out", "o"),
    ("config",),
]


def test_any_number(attack: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DUALWINCH_CC")
    monkeypatch.setattr(
        "dualwinch.codegen.compiler.OPTIMISE", ("-std=c99", "-O0")
    )  # numbers that are 0 are compiled in
    assignment = st.builds("{}={!r}".format, st.sampled_from(KEYS), st.sampled_from(NUMBERS))
    assignments = st.lists(assignment, min_size=1, max_size=4)

    @settings(max_examples=EXAMPLES * attack, suppress_health_check=SLOW)
    @given(st.sampled_from(COMMANDS), assignments)
    def attacked(words: tuple[str, ...], numbers: list[str]) -> None:
        further = ["simulation.duration=0.05", *numbers]
        call([*words, *(word for text in further for word in ("--set", text))], folder)

    attacked()
