import json
import re
from pathlib import Path

import numpy as np
import pytest

from dualwinch.cli import main
from dualwinch.cli.compare import controllers, short_names
from dualwinch.cli.notes import other_ensemble, other_machine, sizes_of_ensemble
from dualwinch.cli.options import ExperimentOptions
from dualwinch.cli.output import json_text
from dualwinch.cli.tune import next_line
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import load, to_toml
from dualwinch.controllers.estimators.kalman import Kalman
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch import authority
from dualwinch.simulation.ensembles.comparison import Comparison
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.settings import override

SHORT = ("--scenarios", "3", "--seed", "5", "--set", "simulation.duration=0.2")

FIRST_KEYS = (
    "name",
    "mean_mse",
    "median_mse",
    "p95_mse",
    "mean_chatter",
    "mean_continuous_load",
    "max_tension",
    "min_tension",
    "slack_share",
    "saturated_share",
    "slack_scenarios",
    "outcomes",
)


@pytest.fixture
def calm(tmp_path: Path) -> Path:
    path = tmp_path / "calm.toml"
    path.write_text('[controller]\nestimator = "kalman"\nobserver.l0 = 9.0\n[plant.vehicle]\nmass = 5e3\n')
    return path


def test_the_papers_gains_have_the_drums_damping_of_the_first_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damped = tmp_path / "damped.toml"
    damped.write_text("[controller]\nwinch_1.damping = 150.0\nwinch_2.damping = 150.0\n")
    main(["compare", "paper", str(damped), *SHORT, "--out", str(tmp_path / "c.json")])
    assert "paper: the paper's gains, with the damping of drums of damped.toml" in capsys.readouterr().out
    paper, _ = json.loads((tmp_path / "c.json").read_text())["files"]
    assert paper["controller"]["winch_2.damping"] == 150


def test_compare_writes_statistics_and_figure(calm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "c.json", tmp_path / "c.svg"
    main(["compare", "paper", str(calm), *SHORT, "--out", str(out), "--plot", str(plot)])
    said = capsys.readouterr().out
    assert "mean e², mean" in said
    assert "chatter" in said
    facts = json.loads(out.read_text())
    paper, other = facts["files"]
    assert [paper["name"], other["name"]] == ["paper", str(calm)]
    assert tuple(paper)[: len(FIRST_KEYS)] == FIRST_KEYS
    assert (facts["scenarios"], facts["seed"], facts["ensemble"]) == (3, 5, "sea")
    assert other["controller"]["observer.l0"] == 9.0
    ratio = other["over_first"]["mse"]["ratio_of_means"]
    assert ratio["estimate"] == pytest.approx(other["mean_mse"] / paper["mean_mse"])
    assert ratio["low"] <= ratio["estimate"] <= ratio["high"]
    assert plot.read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["paper", "runs/a/best.toml", "runs/b/best.toml"], ["paper", "runs/a", "runs/b"]),
        (["runs/a/best.toml", "calm.toml"], ["best.toml", "calm.toml"]),
        (["paper", "runs/a/best.toml"], ["paper", "best.toml"]),
        (["a/x.toml", "b/x.toml", "c.toml"], ["a/x.toml", "b/x.toml", "c.toml"]),
    ],
)
def test_tables_show_what_sets_files_apart(names: list[str], shown: list[str]) -> None:
    assert list(short_names(names).values()) == shown


def test_only_the_controller_of_a_file_counts(calm: Path) -> None:
    """Keys it does not have keep the paper's gains; its plant is not used."""
    loaded = controllers(["paper", str(calm)])
    assert loaded["paper"] == paper_controller()
    ours, papers = leaves(loaded[str(calm)]), leaves(paper_controller())
    assert {key for key in papers.keys() & ours.keys() if ours[key] != papers[key]} == {"estimator", "observer.l0"}
    assert loaded[str(calm)].estimator == Kalman()


def test_json_says_null_where_nothing_completed() -> None:
    sea, metrics = load_ensemble("sea"), {name: np.array([np.inf]) for name in BUILT_IN}
    lost = EnsembleResult(np.array(["diverged"]), np.array([1.0]), metrics, sea, 0, 1, draws={}, traces=None)
    facts = json.loads(json_text(Comparison(sea, {"a": lost, "b": lost}).to_record()))
    assert facts["files"][0]["mean_mse"] is None
    assert facts["files"][1]["over_first"]["mse"]["ratio_of_means"]["low"] is None


def test_a_bound_that_cannot_be_found_does_not_lose_the_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bounds = iter((np.nan, np.nan, 1e-6, 5e-7, 0.0))
    monkeypatch.setattr(authority, "least_mse", lambda *_, **__: next(bounds))
    main(["compare", "paper", *SHORT, "--out", str(tmp_path / "c.json")])
    said = capsys.readouterr().out
    assert "2 of the scenarios are infeasible: they need" in said
    assert "mean MSE of all: 0.5 mm²" in said
    assert "In 1 infeasible scenario the bound could not be found; the mean is over the others." in said
    beyond = json.loads((tmp_path / "c.json").read_text())["beyond_authority"]
    assert (beyond["scenarios"], beyond["without_bound"], beyond["lower_bound_mean_mse"]) == (2, 1, 5e-7)


def test_an_unknown_gain_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text("[controller.observer]\nl00 = 3.0\n")
    with pytest.raises(ConfigurationError, match=r"wrong.toml:2: unknown key 'controller.observer.l00'"):
        controllers([str(path)])


def test_gains_for_another_machine_are_said_with_the_option_that_is_right(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[plant.vehicle]\nmass = 3000\n[plant.track]\nlength = 120\n")
    said = other_machine(mine, "rig", load_ensemble("rig"))
    assert "plant.track.length = 120.0 there, 50.0 here, plant.vehicle.mass = 3000.0 there" in said
    assert said.endswith(f"to judge it on its own: --config {mine}")
    assert not other_machine(mine, "rig", load_ensemble("rig", load(mine)))
    options, own = ExperimentOptions(config=mine), ExperimentOptions(plugin=["my law.py"])
    assert next_line(mine, "rig", options) == f"dualwinch compare paper {mine} --ensemble rig --config {mine}"
    assert next_line(mine, "sea", ExperimentOptions()) == f"dualwinch compare paper {mine} --ensemble sea"
    assert next_line(mine, None, options) == f"dualwinch simulate --config {mine}"
    assert next_line(mine, None, own) == f"dualwinch simulate --config {mine} --plugin 'my law.py'"
    assert next_line(mine, "sea", own) == f"dualwinch compare paper {mine} --ensemble sea --plugin 'my law.py'"


def test_gains_tuned_in_another_ensemble_are_said_with_the_option_that_takes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    best = tmp_path / "best.toml"
    best.write_text("# The best gains of a study.\n# seed: 1\n# ensemble: rig\n\n[controller]\n# ensemble: site\n")
    assert other_ensemble(best, "sea") == (
        f"{best}: tuned in 'rig', judged in 'sea'; to judge it where it was tuned: --ensemble rig"
    )
    assert not other_ensemble(best, "rig")
    assert not other_ensemble(best, "sea", "rig")
    for command in (["compare", str(best)], ["simulate", "--config", str(best), "--ensemble", "sea"]):
        main([*command, *SHORT])
        assert capsys.readouterr().err.count("judged in 'sea'; to judge it where it was tuned: --ensemble rig") == 1
    best.write_text("# ensemble: my machine\n")
    assert other_ensemble(best, "sea").endswith("--ensemble with the file of 'my machine'")
    best.write_text("# ensemble: none\n")
    assert other_ensemble(best, "sea") == f"{best}: tuned in one run, judged in 'sea'"
    best.write_text("# gains of my own\n")
    assert not other_ensemble(best, "sea")


def test_sizes_of_an_ensemble_that_do_not_follow_the_machine_are_said(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[plant.vehicle]\nmass = 3000\n[plant.winch_1]\neccentricity = 2e-4\n")
    said = sizes_of_ensemble(mine, "rig", load_ensemble("rig", load(mine)))
    assert said.startswith(
        f"the ensemble 'rig' has sizes that do not follow from {mine}: plant.winch_*.coulomb_friction"
    )
    mine.write_text("[plant.vehicle]\nmass = 3000\n[plant.winch_1]\ncoulomb_friction = 30\n")
    said = sizes_of_ensemble(mine, "sea", load_ensemble("sea", load(mine)))
    assert f"{mine}: plant.winch_2.coulomb_friction = 96; for your own" in said
    mine.write_text(to_toml(load(mine)))
    assert not sizes_of_ensemble(mine, "sea", load_ensemble("sea", load(mine)))
    assert not sizes_of_ensemble(mine, str(mine), load_ensemble("sea", load(mine)))


def test_gains_for_the_papers_machine_are_said_on_another_and_an_ensemble_says_what_it_sets(tmp_path: Path) -> None:
    """All keys of a whole file count, even where they are defaults; an ensemble's own values are no option's fault."""
    papers, heavy = tmp_path / "papers.toml", tmp_path / "heavy.toml"
    papers.write_text(to_toml(Experiment()))
    heavy.write_text("[plant.winch_1]\ninertia = 50.0\n")
    mine = override(Experiment(), {"plant.vehicle.mass": 3000.0})
    said = other_machine(papers, "sea", load_ensemble("sea", mine))
    assert "(plant.vehicle.mass = 10000.0 there, 3000.0 here)" in said
    assert not other_machine(papers, "sea", load_ensemble("sea"))
    said = other_machine(heavy, "site", load_ensemble("site", load(heavy)))
    assert "plant.winch_1.inertia = 50.0 there, 120.0 here" in said
    assert "the ensemble 'site' sets these itself" in said


def test_config_marks_what_is_still_the_papers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[plant.vehicle]\nmass = 3000\n")
    main(["config", "--config", str(mine), "--set", "plant.vehicle.height=3.0"])
    vehicle = capsys.readouterr().out.partition("[plant.vehicle]")[2].partition("\n[")[0]
    lines = {line.partition(" =")[0]: line.partition("# ")[2] for line in vehicle.splitlines()}
    assert lines["mass"].startswith("[kg]")
    assert lines["height"].startswith("[m]")
    assert lines["diameter"].startswith("PAPER: [m]")
    assert lines["added_mass"].startswith("DEFAULT: [kg]")


@pytest.mark.parametrize("kind", ["file", "way-points"])
def test_config_does_not_mark_what_a_motion_of_ones_own_replaces(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "motion.csv").write_text("t,x\n0,10\n10,20\n20,10\n")
    own = 'file = "motion.csv"\nunit = "m"\n' if kind == "file" else "points = [10, 20]\n"
    (tmp_path / "mine.toml").write_text(f'[reference]\nkind = "{kind}"\n{own}')
    main(["config", "--config", str(tmp_path / "mine.toml")])
    tables = capsys.readouterr().out.partition("[reference]")[2]
    marked = [line for line in tables.partition("[disturbance]")[0].splitlines() if "PAPER: " in line]
    assert [line.partition(" =")[0] for line in marked] == ([] if kind == "file" else ["# speed", "acceleration"])
    (duration,) = (line for line in tables.splitlines() if line.startswith("# duration"))
    assert "PAPER" not in duration


def test_marks_stay_until_they_are_taken_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine, whole = tmp_path / "mine.toml", tmp_path / "whole.toml"
    mine.write_text("[plant.vehicle]\nmass = 3000\n")
    for file in (mine, whole):
        main(["config", "--config", str(file)])
        said = capsys.readouterr()
        text = said.out
        assert re.search(r"^diameter = 2\.0 +# PAPER: ", text, re.MULTILINE)
        assert re.search(r"^points = \[\] +# DEFAULT: ", text, re.MULTILINE)
        assert "plant.vehicle.normal_force = 4900: still the default" in said.err
        whole.write_text(text)
    whole.write_text(re.sub("# PAPER: (.*mean force on the rail)", r"# \1", text))
    main(["config", "--config", str(whole)])
    said = capsys.readouterr()
    assert "still the default" not in said.err
    assert re.search(r"^normal_force = 4900\.0 +# \[N\]", said.out, re.MULTILINE)


@pytest.mark.parametrize(
    ("words", "reason"), [((), "drums that hardly swing"), (("--set", "controller.kind=lqi"), "'lqi' has no design")]
)
def test_config_says_where_a_start_is_no_design(
    words: tuple[str, ...], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[plant.track]\nlength = 80\n")
    main(["config", "--config", str(mine), "--start", *words])
    assert "note: --start: gains as described; " in (said := capsys.readouterr().err)
    assert reason in said
