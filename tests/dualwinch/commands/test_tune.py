"""``dualwinch tune`` as a user runs it, with seconds of simulated time."""

import json
import math
import tomllib
from pathlib import Path

import pytest

from dualwinch.cli import main
from dualwinch.commands.tune import seconds_from
from dualwinch.config.experiment_file import load
from dualwinch.model.tree import leaves
from dualwinch.tuning.study import Progress

SHORT = ("--ensemble", "sea", "--set", "simulation.duration=0.1", "--scenarios", "2", "--seed", "5")


def dualwinch(*words: object) -> int:
    try:
        main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


@pytest.fixture(autouse=True)
def few_held_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dualwinch.commands.tune.HELD_OUT_SCENARIOS", 8)
    monkeypatch.setattr("dualwinch.tuning.scoring.selection.SELECTION_SCENARIOS", 4)
    monkeypatch.setattr("dualwinch.tuning.scoring.selection.LAST_SCENARIOS", 4)
    monkeypatch.setattr("dualwinch.tuning.scoring.selection.SELECTION_CORNERS", 4)
    monkeypatch.setattr("dualwinch.tuning.scoring.scenarios.LOOKED_AT", 4)


def test_tune_writes_a_configuration_and_a_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert dualwinch("tune", *SHORT, "--trials", 40, "--out", tmp_path / "out") == 0
    said = capsys.readouterr()
    assert "in 8 held-out scenarios" in said.out
    assert "times below the paper's" in said.out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 6
    assert "times below that of the paper" in page
    assert "subject to worst.min_tension >= 80 N; worst.peak_tension <= 6000 N; mean.chatter <= " in said.err
    study = json.loads((tmp_path / "out" / "study.json").read_text())
    best = load(tmp_path / "out" / "best.toml")
    assert {key: leaves(best)[key] for key in study["best"]["settings"]} == study["best"]["settings"]
    assert best.controller.estimator == "calibrating-kalman"
    header = (tmp_path / "out" / "best.toml").read_text()
    for word in ("code version: dualwinch", "seed: 5", "ensemble: sea", f"trial: {study['best']['trial']}", "date: "):
        assert word in header
    trials = study["trials"]
    assert trials["number"] == list(range(40))
    assert trials["origin"][0] == "paper"
    columns = [trials["state"], trials["feasible"], *trials["parameters"].values(), *trials["statistics"].values()]
    assert {len(column) for column in columns} == {40}
    assert all(math.isfinite(value) for value in trials["objectives"]["mean.mse"])
    assert study["seeds"] == {"tuning": 5, "selection": 1000005, "held_out": 2000005}
    assert len(study["held_out"]["paper"]["metrics"]["mse"]) == 8
    assert study["units"]["mean.mse"] == "m^2"
    assert tomllib.loads(study["configuration"])["ensemble"]["name"] == "sea"
    rollouts = study["cost"]["rollouts"]
    assert rollouts > 40


def test_a_deterministic_study_with_several_objectives_has_a_front(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--objective", "mean.mse", "--objective", "mean.continuous_load", "--space", "controller.nftsm")
    short = ("--case", 4, "--set", "simulation.duration=0.1", "--constraint", "none", "--trials", 40)
    assert dualwinch("tune", *short, *words, "--out", tmp_path) == 0
    assert "Pareto front" in capsys.readouterr().out
    study = json.loads((tmp_path / "study.json").read_text())
    mse, load = study["trials"]["objectives"].values()
    front = [(mse[number], load[number]) for number in study["pareto_front"]]
    assert front == sorted(front)
    assert [one[1] for one in front] == sorted((one[1] for one in front), reverse=True)
    assert min(mse) == front[0][0]
    assert min(load) == front[-1][1]
    assert study["method"] == "nsga2"
    assert study["constraints"] == []
    assert study["best"]["held_out"] is None


def test_an_interrupt_keeps_the_best_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from dualwinch.tuning import study

    add = Progress.add

    def interrupted(self: Progress, evaluations: list) -> None:
        if self.trials >= 32:
            raise KeyboardInterrupt
        add(self, evaluations)

    monkeypatch.setattr(study.Progress, "add", interrupted)
    assert dualwinch("tune", *SHORT, "--trials", 1000, "--out", tmp_path) == 1
    assert "interrupted; choosing and scoring the best so far" in capsys.readouterr().err
    assert len(json.loads((tmp_path / "study.json").read_text())["trials"]["number"]) == 32
    assert load(tmp_path / "best.toml").controller.estimator == "calibrating-kalman"


@pytest.mark.parametrize(("text", "seconds"), [("60s", 60), ("90", 90), ("5min", 300), ("1.5h", 5400)])
def test_times(text: str, seconds: float) -> None:
    assert seconds_from(text) == seconds


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--time", "soon"], "--time soon: must be a time such as 60s"),
        (["--time", "0s"], "--time 0s"),
        (["--trials", "0"], "--trials 0: must be a whole number >= 1"),
        (["--workers", "2"], "--workers: needs a database"),
        (["--scenarios", "3"], "--scenarios: needs --ensemble"),
        (["--ensemble", "sea", "--scenarios", "0"], "--scenarios 0: must be a whole number >= 1"),
        (["--seed", "-1"], "--seed -1: must be a whole number >= 0"),
        (["--space", "controller.nftsm.bta"], "did you mean 'controller.nftsm.beta'?"),
        (["--space", ""], "--space : names no gain"),
        (["--objective", "men.mse"], "unknown statistic 'men'"),
        (["--constraint", "worst.peak_tension"], "must be STATISTIC<=BOUND"),
        (["--method", "simplex"], "--method simplex: must be one of cmaes"),
        (["--storage", "mysql://me:secret@host/x"], "must be a file, or postgresql+psycopg://"),
        (["--set", "controller.coordination.preload=100"], "controller.coordination.preload = 100"),
    ],
)
def test_wrong_words_are_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = ["--set", "simulation.duration=0.1", "--out", str(tmp_path)]
    if "--ensemble" in words:
        short += ["--set", "simulation.duration=0.1"]
    assert dualwinch("tune", *words, *short) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
