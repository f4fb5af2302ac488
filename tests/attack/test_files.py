"""Any TOML, any CSV, made from valid ones by mutation: a line, an exit code, no traceback, nothing half written."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dualwinch.simulation.ensembles import __file__ as ensembles
from tests.attack.call import SLOW, call
from tests.attack.mutated import mutated
from tests.attack.test_words import SHORT

EXAMPLES = 12
"""Files of each kind in every run."""

SPACE = """[space.controller.nftsm]
beta = { lower = 0.005, upper = 5, log = true }
"p/q" = ["5/3", "7/5"]
[space.controller.observer]
l0 = true
l1 = { lower = 1 }
"""

ONE = ("--trials", "1", "--constraint", "none")
GAIN = ("--space", "controller.nftsm.beta")
FORCE = ("--set", "disturbance.force.file=f.csv", "--set", "disturbance.force.unit=kN")

READERS = {
    "experiment": [
        ("simulate", "--config", "f.toml"),
        ("compare", "paper", "f.toml", "--scenarios", "1", *SHORT),
        ("linearise", "--config", "f.toml"),
        ("export", "c", "--config", "f.toml", "--out", "o"),
        ("certify", "--config", "f.toml"),
        ("tune", "--config", "f.toml", *ONE, *GAIN),
        ("identify", "log.csv", "--fit", "plant.vehicle.mass", "--config", "f.toml"),
    ],
    "ensemble": [
        ("simulate", "--ensemble", "f.toml", "--scenarios", "2", *SHORT),
        ("tune", "--ensemble", "f.toml", *ONE, *GAIN, *SHORT),
    ],
    "space": [("tune", "--case", "4", "--space", "f.toml", *ONE, *SHORT)],
    "signal": [
        ("simulate", *FORCE, *SHORT),
        ("simulate", "--set", "reference.kind=file", "--set", "reference.file=f.csv", *SHORT),
        ("identify", "f.csv", "--fit", "plant.vehicle.mass"),
    ],
}
"""What a file can be, and who reads it."""


@pytest.mark.parametrize("kind", READERS)
def test_any_file(kind: str, attack: int, folder: Path) -> None:
    given_files = {
        "experiment": folder / "good.toml",
        "ensemble": Path(ensembles).parent / "rig.toml",
        "signal": folder / "log.csv",
    }
    text = given_files[kind].read_text(encoding="utf-8") if kind in given_files else SPACE
    file = folder / ("f.csv" if kind == "signal" else "f.toml")
    file.touch()

    @settings(max_examples=EXAMPLES * attack, suppress_health_check=SLOW)
    @given(mutated(text), st.sampled_from(READERS[kind]))
    def attacked(content: bytes, words: tuple[str, ...]) -> None:
        file.write_bytes(content)
        call(words, folder)

    attacked()
