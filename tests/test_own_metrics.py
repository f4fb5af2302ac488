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
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
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


def test_both_engines_compute_them() -> None:
    short = dw.override(EXPERIMENT, {"simulation.duration": 0.5, BAND: 1e-7})
    ours, theirs = dw.simulate(short), dw.simulate(short, engine="interpreter")
    for name in NAMES:
        assert ours.metrics[name] == pytest.approx(theirs.metrics[name], rel=1e-9) != 0, name


def test_runs_without_them_are_the_same_bits_and_code() -> None:
    ours, theirs = dw.simulate(EXPERIMENT), dw.simulate(PLAIN)
    assert {name: ours.metrics[name] for name in BUILT_IN} == dict(theirs.metrics)
    assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
    loop = closed_loop(structure_of(PLAIN))
    assert not [name for name in (*loop.states, *loop.parameters) if "beyond" in name]
    assert loop.states == closed_loop(structure_of(EXPERIMENT)).states[: len(loop.states)]
    assert type(theirs.metrics) is dw.Metrics


def test_a_number_of_theirs_is_a_number_of_the_compiled_code() -> None:
    wider = dw.override(EXPERIMENT, {BAND: 4e-3, "metrics.room.weight": 2})
    assert structure_of(wider) == structure_of(EXPERIMENT)
    result = dw.simulate(wider)
    assert result.metrics["last_beyond"] == pytest.approx(recomputed(result, 4e-3)["last_beyond"])
    assert result.metrics["room"] == pytest.approx(2 * dw.simulate(EXPERIMENT).metrics["room"])
    with pytest.raises(ConfigurationError, match=r"^metrics\.last_beyond\.band = 0: must be a finite number > 0 m$"):
        dw.override(EXPERIMENT, {BAND: 0})
    with pytest.raises(ConfigurationError, match=r"unknown key 'metrics\.last_beyond\.bnd'; did you mean '.*band'"):
        dw.override(EXPERIMENT, {"metrics.last_beyond.bnd": 1})


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


def test_a_result_is_saved_and_loaded(tmp_path: Path) -> None:
    result = dw.simulate(EXPERIMENT)
    for suffix in ("csv", "parquet", "npz", "mat"):
        dw.save(result, tmp_path / f"run.{suffix}")
        assert dw.load_result(tmp_path / f"run.{suffix}", base=dw.case(1, metrics=[Room(), *OWN[:2]])) == result
        with pytest.raises(
            ConfigurationError, match=r"metrics = .*last-beyond.*: no such part is registered; register it, "
        ):
            dw.load_result(tmp_path / f"run.{suffix}")


def test_many_runs_side_by_side_have_them() -> None:
    bands = [1e-3, 5e-3]
    heavier = dw.override(EXPERIMENT, {"plant.vehicle.mass": 1.1e4, "metrics.room.weight": 3})
    batch = dw.rollout([BAND], [[band] for band in bands], [EXPERIMENT, heavier])
    for row, band in enumerate(bands):
        for column, experiment in enumerate((EXPERIMENT, heavier)):
            single = dw.simulate(dw.override(experiment, {BAND: band}))
            for name in NAMES:
                found = batch.metrics[name][row, column]
                assert found == pytest.approx(single.metrics[name], rel=1e-6), (name, row, column)
    both = [f"controller.winch_{winch}.kp" for winch in (1, 2)]
    lost = dw.rollout(both, [[5e-4, 5e-4], [1e9, 1e9]], [EXPERIMENT])
    assert np.isnan(lost.metrics["pull_spread"]).tolist() == [[False], [True]]


def test_they_can_be_differentiated_by_gains() -> None:
    gain, smooth = "controller.observer.l0", dw.override(EXPERIMENT, {"controller.coordination.preload": 5000})
    found = dw.sensitivities([gain], [[5.0]], [smooth], stride=0)
    step = 1e-4
    moved = dw.rollout([gain], [[5 - step], [5 + step]], [smooth]).metrics
    for name in ("mse", "pull_spread"):
        slope = (moved[name][1, 0] - moved[name][0, 0]) / (2 * step)
        assert found.gradients[name][0, 0, 0] == pytest.approx(slope, rel=1e-4, abs=1e-12), name
    assert found.metrics["pull_spread"][0, 0] == pytest.approx(moved["pull_spread"].mean(), rel=1e-6)
    assert found.gradients["last_beyond"][0, 0, 0] == 0


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
    text = dw.to_toml(EXPERIMENT)
    assert "[metrics.last_beyond]  # [s] time at which the error was last beyond the band" in text
    assert "band = 0.002  # [m] half width of the band; > 0" in text
    path = tmp_path / "own.toml"
    path.write_text(text)
    assert dw.load(path, dw.case(4, metrics=OWN[::-1])) == EXPERIMENT
    with pytest.raises(
        ConfigurationError, match=r"own\.toml.*: unknown metric 'last_beyond'; must be one of recovery "
    ):
        dw.load(path)
    for part in (LastBeyond, PullSpread, Room):
        dw.register(part)
    assert dw.load(path) == EXPERIMENT
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


def test_commands_print_them(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["simulate", "--config", str(config)])
    assert "standard deviation of F1 - F2" in capsys.readouterr().out
    few = ("--scenarios", "2", "--config", str(config))
    main(["simulate", "--ensemble", "sea", *few])
    assert "pull_spread" in capsys.readouterr().out
    out = config.with_name("pairs.json")
    main(["compare", "paper", str(config), *few, "--out", str(out)])
    said = capsys.readouterr().out
    assert "pull spread, mean" in said
    first, second = json.loads(out.read_text())["files"]
    assert first["mean_pull_spread"] > 0
    assert set(second["over_first"]) >= set(NAMES)


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


def test_they_guide_the_search() -> None:
    problem = dw.tuning_problem(
        experiment=dw.override(EXPERIMENT, {"simulation.duration": 0.5, "controller.coordination.preload": 5000}),
        space=["controller.observer.l0", "controller.winch.kp"],
        objectives=["pull_spread"],
        constraints=["none", "worst.room>=1"],
    )
    tuned = dw.tune(problem, trials=12, method="cmaes")
    assert tuned.verdict.scored.statistics["mean.pull_spread"] <= tuned.verdict.statistics("start")["mean.pull_spread"]


@pytest.mark.parametrize("name", ["controller", "plant", "closed-loop"])
def test_exports_leave_them_out(name: str) -> None:
    ours, theirs = dw.block(name, EXPERIMENT), dw.block(name, PLAIN)
    assert (ours.states, ours.inputs, ours.outputs, ours.parameters) == (
        theirs.states,
        theirs.inputs,
        theirs.outputs,
        theirs.parameters,
    )
    assert str(ours.step) == str(theirs.step)


def test_linear_loops_leave_them_out() -> None:
    ours, theirs = (dw.linear_closed_loop(experiment, v=0.5) for experiment in (EXPERIMENT, PLAIN))
    assert ours.states == theirs.states
    assert np.array_equal(ours.A, theirs.A)


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
