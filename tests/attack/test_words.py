"""Any words after any command: a line, an exit code, no traceback, nothing half written, an end."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.codegen.errors import DualwinchError
from tests.attack.call import SLOW, call
from tests.attack.words import commands, options

EXAMPLES = 5
"""Calls of each command in every run."""

SHORT = ("--set", "simulation.duration=0.05")

BASES: dict[str, tuple[str, ...]] = {
    "simulate": SHORT,
    "sweep": ("controller.observer.l0=1:3:1", *SHORT),
    "sensitivities": ("plant.vehicle.mass", *SHORT),
    "compare": ("paper", "good.toml", "--scenarios", "2", *SHORT),
    "tune": ("--case", "4", *SHORT, "--trials", "2", "--space", "controller.nftsm.beta", "--constraint", "none"),
    "race": ("--law", "nftsm", "--rollouts", "2", "--scenarios", "1", "--test-scenarios", "2", *SHORT),
    "stress": ("good.toml", "--scenarios", "1"),
    "identify": ("log.csv", "--fit", "plant.vehicle.mass"),
    "certify": SHORT,
    "export c": ("--out", "o"),
    "export fmu": ("--out", "o.fmu"),
    "export mex": ("--out", "o"),
    "export casadi": ("--out", "o"),
    "reproduce": ("--cases", "1", "--controllers", "nftsm"),
}
"""What a command is given that does something, and little of it."""

LONG = ("race", "tune", "reproduce")
"""Commands that do much before they need a compiler where they are asked for nothing less."""

COMMANDS = {" ".join(name): command for name, command in commands()}


@pytest.mark.parametrize("name", COMMANDS)
def test_any_words(name: str, attack: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise DualwinchError("solves nothing here")

    # the only long work that needs no compiler, and a server
    for work in ("analysis.preload.preloads", "toolboxes.lab.cli.lab.page_of", "toolboxes.lab.cli.show.page_of"):
        monkeypatch.setattr(f"dualwinch.{work}", refuse)

    @settings(max_examples=EXAMPLES * attack, suppress_health_check=SLOW)
    @given(st.lists(options(COMMANDS[name]), min_size=1, max_size=3), st.booleans())
    def attacked(further: list[list[str]], alone: bool) -> None:
        base = () if alone and name not in LONG else BASES.get(name, ())
        answer = call([*name.split(), *base, *(word for words in further for word in words)], folder)
        assert "secret" not in answer.error

    attacked()


@settings(max_examples=20, suppress_health_check=SLOW)
@given(
    words=st.lists(
        st.one_of(st.text(max_size=10), st.sampled_from(["--version", "--help", "-h", *COMMANDS])), max_size=3
    )
)
def test_no_command(words: list[str], tmp_path_factory: pytest.TempPathFactory) -> None:
    if words[:1] not in [[name] for name in COMMANDS]:  # those are tested above
        call(words, tmp_path_factory.mktemp("nothing"))
