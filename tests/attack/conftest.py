"""How hard to attack, ``pytest tests/attack --attack 50``, and where."""

import shutil
from pathlib import Path

import pytest

from dualwinch.config.experiment_file import experiment_from, to_toml
from dualwinch.simulation.ensembles import __file__ as ensembles

LAW = "from dualwinch import nonsense\n"
LOG = "t,x,v,tau_1,tau_2\n" + "".join(f"{index / 1000},1,0,20,20\n" for index in range(20))


@pytest.fixture
def attack(request: pytest.FixtureRequest) -> int:
    """How many times as hard as in every run."""
    return int(request.config.getoption("attack") or 1)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with files to read, and no compiler: what comes before the work is attacked, not the work."""
    cache = tmp_path / "cache"
    cache.mkdir()
    monkeypatch.setenv("DUALWINCH_CACHE_DIR", str(cache))
    monkeypatch.setenv("DUALWINCH_CC", str(tmp_path / "no-compiler"))
    monkeypatch.setenv("COLUMNS", "120")
    there = tmp_path / "there"
    (there / "folder").mkdir(parents=True)
    good = to_toml(experiment_from(4, None, None, ["simulation.duration=0.05"]))
    (there / "good.toml").write_text(good, encoding="utf-8")
    (there / "f.toml").write_text("[plant.vehicle]\nmass = -1\n")
    shutil.copy(Path(ensembles).parent / "sea.toml", there / "sea.toml")
    (there / "law.py").write_text(LAW)
    (there / "log.csv").write_text(LOG)
    return there
