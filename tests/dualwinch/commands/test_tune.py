"""``dualwinch tune`` as a user runs it, with seconds of simulated time."""

import json
import math
import re
import subprocess
import sys
import tomllib
from html import escape, unescape
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from dualwinch.cli import main
from dualwinch.cli.notes import other_ensemble
from dualwinch.cli.options import seconds_from
from dualwinch.cli.progress import ProgressLine
from dualwinch.config.experiment_file import load
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.tuning.optimisers import METHODS
from dualwinch.tuning.scoring.progress import DESIGNING, PHASES, SearchStatus, TuningProgress
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.conftest import exit_code
from tests.spring_law import SPRING
from tests.tuning.test_tune import Stubborn

SEA = ("--ensemble", "sea", "--set", "simulation.duration=0.1", "--scenarios", "2", "--seed", "5")
SHORT = (*SEA, "--violation", "30%")
"""Few fresh draws support so large a probability."""
FEW = (*SHORT, "--constraint", "none", "--constraint", "mean.chatter<=1*paper")
"""Without the usual bounds on margins, whose machines take most of the time."""
TRIALS = 80  # enough of them are complete for every figure


def test_tune_writes_a_configuration_and_a_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[plant.vehicle]\nmass = 10e3  # CHECKED on the scales\n")
    assert exit_code("tune", *SHORT, "--config", mine, "--trials", TRIALS, "--out", tmp_path / "out") == 0
    said = capsys.readouterr()
    assert re.search(r"^mass = 10000\.0 +# CHECKED: ", (tmp_path / "out" / "best.toml").read_text(), re.MULTILINE)
    assert "is the best; scored in 200 test scenarios" in said.out
    assert "bounds hold in ≥ 70 % of draws" in said.out.splitlines()[0]
    assert "test set, with 95 % intervals: mean.mse = " in said.out
    assert "times lower than the paper's and" in said.out
    assert "start: fando-nftsm (estimator calibrating-kalman, differential-tension) " in said.out
    assert "paper: fando-nftsm (no estimator, differential-tension) with the paper's gains" in said.out
    said_of_it = [line.removeprefix("tune: ") for line in said.err.splitlines() if line.startswith("tune: ")]
    assert [
        words for words in said_of_it if not re.search(" trials|^compiled in| %|^certifying: ", words)
    ] == [  # a slow machine says more
        "reading the problem",
        DESIGNING,
        *PHASES,
        "writing best.toml, study.json and report.html",
    ]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 6
    assert "times lower than the paper&#39;s and" in page
    assert re.search(r"Root mean square error: \d\S* .?m, where it was \d\S* .?m with the start and \d", page)
    assert re.search(r"Chatter: 0\.\d+ × the paper&#39;s, no cost\.", page)
    assert f"dualwinch stress {tmp_path / 'out' / 'best.toml'} --out {tmp_path / 'out'}" in page
    wanted = "worst.min_tension >= 80 N; worst.peak_tension <= 6000 N; mean.chatter <= 0.25 times the paper's"
    assert f"subject to {wanted}" in said.err
    study = json.loads((tmp_path / "out" / "study.json").read_text())
    assert [one["name"] for one in study["idealisations"]][:2] == ["winch inertia", "sag"]
    assert study["idealisations"][0]["statement"] in page
    (searched,) = (bound["label"] for bound in study["constraints"] if bound["statistic"] == "mean.chatter")
    assert f"has another value in other scenarios: in the search {escape(searched)}." in page
    assert "\nidealised: winches of 1.8 kg m²" in said.out
    best = load(tmp_path / "out" / "best.toml")
    assert {key: leaves(best)[key] for key in study["best"]["settings"]} == study["best"]["settings"]
    assert best.controller.estimator.kind == "calibrating-kalman"
    header = (tmp_path / "out" / "best.toml").read_text()
    for word in ("code version: dualwinch", "seed: 5", "ensemble: sea", f"trial: {study['best']['trial']}", "date: "):
        assert word in header
    assert not other_ensemble(tmp_path / "out" / "best.toml", "sea")
    assert other_ensemble(tmp_path / "out" / "best.toml", "rig")
    trials = study["trials"]
    assert trials["number"] == list(range(TRIALS))
    assert trials["origin"][0] == "paper"
    columns = [trials["state"], trials["feasible"], *trials["parameters"].values(), *trials["statistics"].values()]
    assert {len(column) for column in columns} == {TRIALS}
    assert all(value is None or math.isfinite(value) for value in trials["objectives"]["mean.mse"])
    assert sum(value is not None for value in trials["objectives"]["mean.mse"]) > TRIALS // 2
    assert study["seeds"] == {name: named_seed(5, name) for name in ("training", "checks", "certificate", "test")}
    assert {name: len(table["metrics"]["mse"]) for name, table in study["test"].items()} == dict.fromkeys(
        ("best", "start", "paper"), 200
    )
    assert study["best"]["start_kept"] is None
    assert study["best"]["certificate"]["draws"] >= 12
    low, high = study["best"]["test_violation_interval"]
    assert low <= study["best"]["test_violations"] / 200 <= high
    assert study["units"]["mean.mse"] == "m^2"
    assert tomllib.loads(study["configuration"])["ensemble"]["name"] == "sea"
    rollouts, judging = study["cost"]["rollouts"], study["cost"]["judging_rollouts"]
    assert rollouts > judging >= 612
    assert f"\n{rollouts} rollouts, {judging} of them for choosing and scoring; " in said.out
    cost_line = next(line for line in said.out.splitlines() if line.startswith(f"{rollouts} rollouts"))
    phases = re.findall(r"[\d.]+ s ([a-z ]+)", cost_line)
    assert phases[:5] == [
        "reading the problem",
        "preparing",
        "searching ",
        "choosing and scoring",
        "writing files",
    ]


@pytest.mark.slow
def test_a_best_whose_loop_is_unstable_at_small_amplitudes_is_said_to_be_wherever_it_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the function that `simulate` and `export` use."""
    words = "unstable at small amplitudes: at rest at 25 m deviations grow by 1.2 1/s"
    monkeypatch.setattr("dualwinch.tuning.result.loop_notes", lambda _: iter([words]))
    assert exit_code("tune", *SHORT, "--trials", 16, "--out", tmp_path) == 0
    printed = capsys.readouterr().out
    best, report = (tmp_path / "best.toml").read_text(), (tmp_path / "report.html").read_text(encoding="utf-8")
    headline, brief = printed.splitlines()[0], "the loop with these gains is unstable at small amplitudes"
    sentence = f"{brief.capitalize()}."
    assert f". {sentence}" in headline
    assert f"\nnote: {words}\n" in printed
    assert f"# {headline}\n" in best
    assert f"# note: {words}\n" in best
    study = json.loads((tmp_path / "study.json").read_text())
    assert (study["best"]["instability"], study["best"]["remarks"]) == (brief, [words])
    assert f" {sentence} " in report
    assert f"U{words[1:]}." in report


@pytest.mark.slow
def test_commands_about_gains_of_a_law_of_ones_own_name_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    plugin, out = tmp_path / "spring.py", tmp_path / "out"
    plugin.write_text(SPRING)
    words = "unstable at small amplitudes: at rest at 25 m (dualwinch linearise --loop closed --x 25)"
    monkeypatch.setattr("dualwinch.tuning.result.loop_notes", lambda _: iter([words]))
    law = ("--plugin", plugin, "--set", "controller.kind=spring", "--constraint", "none")
    assert exit_code("tune", *law, "--case", 4, "--set", "simulation.duration=0.1", "--trials", 4, "--out", out) == 0
    said = capsys.readouterr()
    best = f"--config {out / 'best.toml'} --plugin {plugin}"
    assert f"(dualwinch linearise {best} --loop closed --x 25)" in said.out
    (command,) = re.findall(r"next: dualwinch (.*)", said.err)
    assert command == f"simulate {best}"
    assert exit_code(*command.split()) == 0
    assert "spring: completed" in capsys.readouterr().out
    report = (out / "report.html").read_text(encoding="utf-8")
    commands = re.findall(r"dualwinch [^<)]*best\.toml[^<)]*", report)
    assert len(commands) >= 2
    assert all(f" --plugin {plugin} " in each for each in commands), commands
    noted = f"(dualwinch linearise --config best.toml --plugin {Path('..') / 'spring.py'} --loop closed --x 25)"
    assert noted in (out / "best.toml").read_text()
    remarks = json.loads((out / "study.json").read_text())["best"]["remarks"]
    assert any(noted in words for words in remarks)


@pytest.mark.slow
def test_the_report_compares_in_the_file_of_an_ensemble_of_ones_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "my sea.toml"
    mine.write_text("""
        [ensemble]
        name = "choppy"
        description = "a sea of mine"

        [simulation]
        duration = 0.1

        [distributions]
        "plant.vehicle.mass" = { uniform = [0.9, 1.1], of = "nominal" }
    """)
    words = ("--constraint", "none", "--scenarios", 2, "--trials", 64, "--out", tmp_path / "out")
    assert exit_code("tune", "--ensemble", mine, *words) == 0
    (following,) = re.findall(r"next: (dualwinch compare .*)", capsys.readouterr().err)
    assert f"--ensemble '{mine}'" in following
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert f"{following} --seed 1000" in unescape(report)


@pytest.mark.slow
def test_a_deterministic_study_with_several_objectives_has_a_front(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--objective", "mean.mse", "--objective", "mean.continuous_load", "--space", "controller.nftsm")
    short = ("--case", 4, "--set", "simulation.duration=0.1", "--constraint", "none", "--trials", 40)
    assert exit_code("tune", *short, *words, "--out", tmp_path) == 0
    assert "Pareto front" in capsys.readouterr().out
    study = json.loads((tmp_path / "study.json").read_text())
    mse, load = study["trials"]["objectives"].values()
    front = [(mse[number], load[number]) for number in study["pareto_front"]]
    assert front == sorted(front)
    assert [point[1] for point in front] == sorted((point[1] for point in front), reverse=True)
    assert min(mse) == front[0][0]
    assert min(load) == front[-1][1]
    assert study["method"] == "nsga2"
    assert study["constraints"] == []
    assert study["best"]["test"] is None


@pytest.mark.slow
def test_an_interrupt_keeps_the_best_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    add = SearchStatus.add

    def interrupted(self: SearchStatus, evaluations: list) -> None:
        if self.trials >= 32:
            raise KeyboardInterrupt
        add(self, evaluations)

    monkeypatch.setattr(SearchStatus, "add", interrupted)
    assert exit_code("tune", *FEW, "--trials", 1000, "--out", tmp_path) == 130
    said = capsys.readouterr().err
    assert "interrupted; this is the best so far" in said
    assert said.endswith("interrupted; the study is kept; the same call with --resume goes on\n")
    assert len(json.loads((tmp_path / "study.json").read_text())["trials"]["number"]) >= 32
    assert load(tmp_path / "best.toml").controller.estimator.kind == "calibrating-kalman"


def test_gains_no_better_than_the_start_are_not_called_best(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(METHODS, "stubborn", Stubborn)
    short = ("--case", 4, "--set", "simulation.duration=0.1", "--set", "controller.observer.l0=7", "--trials", 20)
    words = ("--space", "controller.nftsm.beta", "--constraint", "none", "--method", "stubborn")
    for module in ("study", "tune"):
        monkeypatch.setattr(f"dualwinch.tuning.{module}.first_candidates", lambda _: [])
    assert exit_code("tune", *short, *words, "--out", tmp_path) == 0
    said, announced = capsys.readouterr()
    assert "tuning 1 gain of fando-nftsm " in announced
    assert "the start is kept: no trial is better than the gains that the search started from (20 trials)" in said
    assert "what would help: more trials" in said
    assert "another method (--method cmaes)" in said
    assert "No improvement: the start is kept. Mean.mse is 1.09 times lower than the paper's" in said
    best, paper = leaves(load(tmp_path / "best.toml")), leaves(case(4))
    assert best["controller.observer.l0"] == 7
    assert best["controller.nftsm.beta"] == paper["controller.nftsm.beta"]
    assert "# trial: the start" in (tmp_path / "best.toml").read_text()
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The start is kept: no trial is better" in page
    assert "<li>Another method (--method cmaes).</li>" in page
    assert "Root mean square error" not in page
    assert json.loads((tmp_path / "study.json").read_text())["best"]["trial"] is None


@pytest.mark.slow
def test_another_law_is_compared_with_the_papers_controller_and_with_its_own_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ("--set", "controller.kind=adrc", "--set", "simulation.duration=1")
    assert exit_code("tune", "--case", 4, *settings, "--trials", 20, "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "start: adrc (estimator lowpass" in said
    assert "paper: fando-nftsm (no estimator" in said
    study = json.loads((tmp_path / "study.json").read_text())
    paper = rollout([], [[]], [override(case(4), {"simulation.duration": 1.0, "controller.estimator": "none"})])
    adrc = rollout([], [[]], [override(case(4, "adrc"), {"simulation.duration": 1.0})])
    for name, result in (("paper", paper), ("start", adrc)):
        assert study[name]["statistics"]["mean.mse"] == pytest.approx(result.metrics["mse"][0, 0], rel=1e-9)
    bound = next(entry["bound"] for entry in study["constraints"] if entry["statistic"] == "mean.chatter")
    assert bound == pytest.approx(paper.metrics["chatter"][0, 0], rel=1e-9)
    assert study["trials"]["origin"][0] == "start"


@pytest.mark.parametrize(
    ("patient", "steps", "lines"),
    [
        (
            False,
            [(0.0, 0.0, "fitting"), (5.0, 0.1, ""), (12.0, 0.25, ""), (13.0, 0.3, "")],
            ["fitting", "fitting, 25 % · 36 s left"],
        ),
        (
            True,
            [(5.0, 0.1, ""), (12.0, 0.25, ""), (13.0, 0.3, "drawing"), (24.0, 0.3, "")],
            ["simulating, 25 % · 36 s left", "drawing, 30 %"],
        ),
    ],
)
def test_a_log_says_how_far_a_phase_is_every_ten_seconds(
    patient: bool, steps: list[tuple[float, float, str]], lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now, log = [0.0], StringIO()
    monkeypatch.setattr("dualwinch.cli.progress.time.monotonic", lambda: now[0])
    words = ("simulating",) if patient else ()
    line = ProgressLine(*words, command="identify", patient=patient, console=Console(file=log, width=80))
    for now[0], fraction, phase in steps:
        line(fraction, phase)
    assert log.getvalue().splitlines() == [f"identify: {each}" for each in lines]


def test_what_was_compiled_is_said_with_its_time() -> None:
    said = list[str]()

    def hear(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        said.append(phase or status)

    watch = TuningProgress(hear)
    watch.compiled(0.2)
    watch.compiled(77.7)
    assert said == ["compiled in 78 s"]


def test_the_first_line_is_there_before_the_rest_of_the_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class GoneError(BaseException):
        """Stands for what takes long."""

    def gone(*_: object, **__: object) -> None:
        raise GoneError

    monkeypatch.setattr("dualwinch.tuning.tuning_problem.tuning_problem", gone)
    with pytest.raises(GoneError):
        main(["tune", "--case", "4"])
    assert capsys.readouterr().err == "tune: reading the problem\n"
    light = "import sys, dualwinch.cli.progress; sys.exit('numpy' in sys.modules or 'casadi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", light], check=False).returncode == 0


def test_strings_are_paths(tmp_path: Path) -> None:
    file, space = tmp_path / "my.toml", tmp_path / "space.toml"
    file.write_text("[controller.observer]\nl0 = 7.0\n")
    space.write_text("[space]\ncontroller.observer.l0 = true\n")
    problem = tuning_problem(config=str(file), space=[str(space)], settings=["simulation.duration=0.1"])
    assert problem.start == {"controller.observer.l0": 7.0}


@pytest.mark.parametrize(("text", "seconds"), [("60s", 60), ("90", 90), ("5min", 300), ("1.5h", 5400), ("1e2s", 100)])
def test_times(text: str, seconds: float) -> None:
    assert seconds_from(text) == seconds
