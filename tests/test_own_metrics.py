"""Figures of merit of a user's own: whatever works with a built-in one works with these."""

import json
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.experiment import Simulation
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.results.result import Result
from tests.own_metrics import LastBeyond, PullSpread, Room

OWN = (LastBeyond(2e-3), PullSpread(), Room())
NAMES = ("last_beyond", "pull_spread", "room")
PLAIN = dw.case(4)
EXPERIMENT = replace(PLAIN, metrics=OWN)
BAND = "metrics.last_beyond.band"


def recomputed(result: Result, band: float = 2e-3) -> dict[str, float]:
    """The same from the columns of a run without delay."""
    beyond = np.abs(result["e"]) > band
    return {
        "last_beyond": result["t"][beyond].max() if beyond.any() else 0.0,
        "pull_spread": (result["F1"] - result["F2"]).std(),
        "room": 133.0 - max(result["tau_1"].max(), result["tau_2"].max()),
    }


def test_they_are_computed_beside_the_built_in_ones() -> None:
    result = dw.simulate(EXPERIMENT)
    assert tuple(result.metrics) == (*BUILT_IN, *NAMES)
    for name, value in recomputed(result).items():
        assert result.metrics[name] == getattr(result.metrics, name) == pytest.approx(value, rel=1e-9), name
    assert 0 < result.metrics["last_beyond"] < 40


def test_a_run_that_was_not_completed_has_none() -> None:
    lost = dw.simulate(dw.override(EXPERIMENT, {"controller.winch_1.kp": 1e9, "controller.winch_2.kp": 1e9}))
    assert lost.outcome != "completed"
    assert np.isnan([lost.metrics[name] for name in NAMES]).all()


def test_they_are_shown_and_named() -> None:
    result = dw.simulate(EXPERIMENT)
    html = result._repr_html_()
    assert "pull_spread" in html
    assert "standard deviation of F1 - F2" in html
    assert f"pull_spread {result.metrics['pull_spread']:.4g} N" in repr(result)
    room = result.metrics.quantities["room"]
    assert (room.unit, room.meaning) == (Room.quantity.unit, Room.quantity.meaning)
    assert (room.label, room.small_is_bad) == ("room", True)
    assert pickle.loads(pickle.dumps(result.metrics)) == result.metrics  # noqa: S301
    with pytest.raises(UnknownNameError, match="unknown metric 'rom'; did you mean 'room'"):
        _ = result.metrics["rom"]
    with pytest.raises(AttributeError):
        _ = result.metrics.rom  # pyright: ignore[reportAttributeAccessIssue]
    assert result.to_pandas().attrs["room"] == result.metrics["room"]


def test_ensembles_have_their_statistics(tmp_path: Path) -> None:
    sea = dw.load_ensemble("sea", dw.override(EXPERIMENT, {"simulation.duration": 1.0}))
    result = dw.run_ensemble(sea, 5, 3, traces=False)
    assert set(NAMES) <= set(result.metrics) & set(result.statistics)
    assert result.statistic("worst.room") == result.metrics["room"].min() == result.statistics["room"]["worst"]
    assert result.statistic("worst.pull_spread") == result.metrics["pull_spread"].max()
    with pytest.raises(ConfigurationError, match="unknown metric 'pull_sprad'; did you mean 'pull_spread'"):
        result.statistic("mean.pull_sprad")
    dw.save_ensemble(result, tmp_path / "sea.csv")
    assert (tmp_path / "sea.csv").read_text().splitlines()[0].endswith(",last_beyond,pull_spread,room")


def test_comparisons_and_sweeps_have_them() -> None:
    short = dw.override(EXPERIMENT, {"simulation.duration": 1.0})
    found = dw.compare(
        {"paper": dw.paper_controller(), "pid": dw.case(4, "pid-cascade").controller},
        dw.load_ensemble("sea", short),
        4,
        1,
    )
    paper, pid = found.contenders.values()
    assert pid.summary()["mean_pull_spread"] == pid.metrics["pull_spread"].mean()
    ratio = found.paired("pid")["pull_spread"].ratio_of_means.estimate
    assert ratio == pytest.approx(pid.metrics["pull_spread"].mean() / paper.metrics["pull_spread"].mean())
    swept = dw.sweep(short, {BAND: [1e-3, 1e-2], "controller.kind": ["nftsm", "adrc"]})
    assert swept.metrics["last_beyond"].shape == (2, 2)
    assert swept.metrics["last_beyond"][0, 0] >= swept.metrics["last_beyond"][1, 0]
    assert swept.plot("last_beyond").axes


@pytest.mark.parametrize("objective", ["mean.pull_spread", "last_beyond"])
def test_they_are_objectives_and_constraints(objective: str) -> None:
    problem = dw.tuning_problem(
        experiment=dw.override(EXPERIMENT, {"simulation.duration": 0.5}),
        space=["controller.observer.l0"],
        objectives=[objective],
        constraints=["worst.room>=1", "mean.pull_spread<=10*paper"],
    )
    tuned = dw.tune(problem, trials=6, method="tpe")
    scored = tuned.verdict.scored
    assert {"mean.pull_spread", "mean.last_beyond", "worst.room"} <= set(scored.statistics)
    assert problem.units["worst.room"] == "N m"
    assert tuned.verdict.scored.feasible
    again = dw.simulate(tuned.best).metrics
    assert scored.statistics["worst.room"] == pytest.approx(again["room"], rel=1e-6)


def test_one_whose_small_values_are_bad_is_no_objective() -> None:
    with pytest.raises(ConfigurationError, match=r"mean\.room: small is bad; make it a constraint, mean\.room>="):
        dw.tuning_problem(experiment=EXPERIMENT, objectives=["room"])
    with pytest.raises(ConfigurationError, match="unknown metric 'room'"):
        dw.tuning_problem(case=4, objectives=["room"])


def test_files_name_them(tmp_path: Path) -> None:
    for part in (LastBeyond, Room):
        dw.register(part)
    path = tmp_path / "own.toml"
    for words in (
        'metrics = ["last-beyond", "room"]',
        'metrics = [{ kind = "last-beyond", band = 1e-3 }, "room"]',
        "[metrics.last_beyond]\nband = 1e-3\n[metrics.room]",
        "[metrics]\nlast-beyond = {}\nroom = {}",
    ):
        path.write_text(words)
        assert dw.load(path).metrics == (LastBeyond(), Room()), words
    assert dw.load(path, settings={"metrics": ["room"]}).metrics == (Room(),)
    assert dw.override(dw.case(4), {"metrics": ["room"], "metrics.room.limit": 9}).metrics == (Room(9.0),)
    with pytest.raises(
        ConfigurationError, match=r'^metrics\.room\.limit: belongs to "room", which is not among metrics = \[\]$'
    ):
        dw.override(dw.case(4), {"metrics.room.limit": 9})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ('metrics = ["rom"]', "own.toml:1: unknown metric 'rom'; did you mean 'room'"),
        ("metrics = 3", "own.toml:1: metrics = 3: must be a list such as"),
        ("metrics = [3]", "own.toml:1: metrics: 3: must be a list such as"),
        ('metrics = ["room", "room"]', "own.toml:1: metrics: 'room' is given twice"),
        ("[metrics]\nroom = 1", "metrics.room = 1: must be a table, [metrics.room]"),
        ("[metrics.room]\nlimt = 1", "own.toml:2: unknown key 'metrics.room.limt'; did you mean 'metrics.room.limit'"),
        ("[metrics.room]\nlimit = -1", "own.toml:2: metrics.room.limit = -1: must be a finite number > 0 N m"),
    ],
)
def test_wrong_entries_are_one_line(words: str, message: str, tmp_path: Path) -> None:
    dw.register(Room)
    path = tmp_path / "own.toml"
    path.write_text(words)
    with pytest.raises(ConfigurationError) as caught:
        dw.load(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A file of an experiment with registered metrics."""
    for part in (LastBeyond, PullSpread, Room):
        dw.register(part)
    path = tmp_path / "own.toml"
    path.write_text(dw.to_toml(dw.override(EXPERIMENT, {"simulation.duration": 0.5})))
    return path


@pytest.mark.slow
def test_studies_keep_them(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = config.with_name("tuned")
    words = ("--space", "controller.observer.l0", "--trials", "3", "--out", str(out), "--config", str(config))
    main(["tune", *words, "--objective", "mean.pull_spread", "--constraint", "worst.room>=1"])
    assert "worst.room" in capsys.readouterr().out
    study = json.loads((out / "study.json").read_text())
    assert study["units"]["mean.pull_spread"] == "N"
    assert study["metric_units"]["room"] == "N m"
    assert "worst.room >= 1 N m" in (out / "best.toml").read_text()
    assert dw.load(out / "best.toml").metrics == OWN
    main(["tune", *words, "--objective", "mean.pull_spread", "--constraint", "worst.room>=1", "--resume"])
    assert "trial" in capsys.readouterr().out


@dataclass(frozen=True)
class Broken(Metric):
    kind: ClassVar = "broken"
    quantity: ClassVar = Quantity("1", "goes wrong")

    def initial_state(self) -> Any:
        return 0.0

    def step(self, state: Any, sample: Any, sample_time: Any) -> Any:  # noqa: ARG002
        return state


class Taken(Broken):
    kind: ClassVar = "mse"


class Branches(Broken):
    def step(self, state: Any, sample: Any, sample_time: Any) -> Any:  # noqa: ARG002
        return sample.t if sample.F1 > 0 else state


class Meaningless(Broken):
    quantity: ClassVar = None


class Grows(Broken):
    def step(self, state: Any, sample: Any, sample_time: Any) -> Any:  # noqa: ARG002
        return np.zeros(2)


class Worded(Broken):
    def initial_state(self) -> Any:
        return "nothing"


class Listed(Broken):
    def value(self, state: Any, samples: Any) -> Any:  # noqa: ARG002
        return np.zeros(3)


@pytest.mark.parametrize(
    ("metrics", "message"),
    [
        (Broken(), "metrics: must be a list of metrics, e.g. metrics=[Broken()]"),
        ([Broken], "metrics[0]: must be Broken(), not Broken"),
        ([3], "metrics[0]: must be a Metric, not int"),
        ([Broken(), Broken()], "metric 'broken': is given twice"),
        ([Taken()], "metric 'mse': the name is taken by a built-in figure of merit"),
        ([Branches()], "metric 'broken': its step asks for the value of a symbol; use where(condition, a, b) of "),
        ([Meaningless()], "metric 'broken': has no quantity; write e.g. quantity = Quantity(\"s\", "),
        ([Grows()], "metric 'broken': its step must give a state of the elements it was given, not value"),
        ([Worded()], "metric 'broken': initial_state must give a number, an array or a dataclass of them, not str"),
        ([Listed()], "metric 'broken': its value must be a number for each run, shape (), not float64 of shape (3,)"),
    ],
)
def test_what_is_wrong_with_one_is_one_line(metrics: Any, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        dw.simulate(replace(PLAIN, metrics=metrics, simulation=Simulation(duration=0.1)))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
