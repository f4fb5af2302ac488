"""``dualwinch race`` as a user runs it, with a tenth of a second of simulated time."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.cli.notes import other_ensemble
from dualwinch.config.ensemble_file import loads_ensemble
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.quantities.tree import leaves
from dualwinch.toolboxes.race import race as race_module
from dualwinch.toolboxes.stress import stress as stress_module
from tests.conftest import Refused
from tests.spring_law import SPRING
from tests.toolboxes.race.made_up import made_up
from tests.toolboxes.stress.ensembles import DRUMS

SHORT = ("--set", "simulation.duration=0.1", "--rollouts", "60", "--scenarios", "2", "--test-scenarios", "4")
SEA = ("race", "--ensemble", "sea", "--estimator", "kalman", *SHORT)
BOUNDS = ("none", "mean.chatter<=1*paper")
"""Instead of the usual constraints, with stability margins, whose machines take most of a small race's time."""
QUICK = (*SEA, *(word for bound in BOUNDS for word in ("--constraint", bound)))


@pytest.mark.parametrize("words", [QUICK, pytest.param(SEA, marks=pytest.mark.slow)], ids=["few", "usual"])
def test_a_race_is_printed_written_and_added_to(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "race"
    main([*words, "--law", "nftsm", "--seed", "3", "--out", str(out)])
    said = capsys.readouterr()
    assert "Race: 1 entry, 60 rollouts of 'sea' each, scored in 4 test scenarios, seed 3" in said.out
    assert "race: nftsm: drawing scenarios" in said.err
    assert f"wrote race.json, race.svg, fronts.svg, report.html, gains/ in {out}" in said.err
    plugin = tmp_path / "spring.py"
    plugin.write_text(SPRING)
    main([*words, "--plugin", str(plugin), "--law", "spring", "--seed", "3", "--out", str(out)])
    said = capsys.readouterr()
    assert "Race: 2 entries" in said.out
    assert "race: 1 of 2, spring: searching" in said.err
    assert "nftsm: " not in said.err, "it is finished"
    facts = json.loads((out / "race.json").read_text())
    assert {entry["law"] for entry in facts["entries"]} == {"nftsm", "spring"}
    for entry in facts["entries"]:
        assert entry["search"]["rollouts"] >= 45, "it leaves room for a halved generation or another certificate"
        stem = f"{entry['law']}+kalman+differential-tension"
        best = dw.load(out / "gains" / f"{stem}.toml")
        assert "tuned in 'sea'" in other_ensemble(out / "gains" / f"{stem}.toml", "rig")
        values = leaves(best)
        assert {key: values[key] for key in entry["gains"]} == entry["gains"]
        assert values["controller.estimator"] == "kalman"
        assert values["simulation.duration"] == 0.1
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "does not differ from" in page
    assert "http" not in page.partition("<pre>")[0].replace("http-equiv", "")


@pytest.mark.slow
def test_python_gives_what_the_command_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main([*QUICK, "--law", "nftsm", "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    words: dict[str, Any] = {
        "laws": "nftsm",
        "estimators": ["kalman"],
        "rollouts": 60,
        "scenarios": 2,
        "test_scenarios": 4,
    }
    words |= {"constraints": BOUNDS}
    found = dw.race("sea", settings=["simulation.duration=0.1"], **words)
    assert printed == f"{found!r}\n"
    drawn = dw.load_ensemble("sea", dw.override(dw.Experiment(), {"simulation.duration": 0.1}))
    assert dw.race(drawn, **words).ratios == found.ratios


@pytest.mark.slow
def test_searches_have_seeds_of_their_own_and_are_scored_in_the_same_scenarios() -> None:
    words: dict[str, Any] = {
        "laws": "nftsm",
        "estimators": "kalman",
        "rollouts": 60,
        "scenarios": 2,
        "test_scenarios": 4,
    }
    words |= {"constraints": BOUNDS}
    settings = ["simulation.duration=0.1"]
    two = dw.race("sea", settings=settings, searches=2, **words)
    one = dw.race("sea", settings=settings, **words)
    first, second = sorted(two.entries, key=lambda scored: scored.entry.search)
    assert first.gains == one.entries[0].gains != second.gains
    assert two.paper.runs.metrics["mse"].tolist() == one.paper.runs.metrics["mse"].tolist()
    assert len(two.ranking) == 1
    with pytest.raises(dw.ConfigurationError, match="searches = 0: must be a whole number >= 1"):
        dw.race("sea", searches=0)


@pytest.mark.slow
def test_who_takes_part_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every law with the ensemble's filter, and nothing of what is asked for otherwise."""
    seen: list[list[str]] = []

    def noted(entrants, *_, **__):
        seen.append([entrant.entry.key for entrant in entrants])

    monkeypatch.setattr(race_module, "run_race", noted)
    dw.race("rig")
    laws = list(POSITION_LAWS)
    assert seen[-1] == [f"{law}, self-calibrating-kalman, differential-tension" for law in laws]
    dw.race("sea", laws=["adrc"], estimators="all", coordinations="all")
    assert len(seen[-1]) == len(ESTIMATORS) * len(COORDINATIONS)
    dw.race("sea", laws=["fando-nftsm"], ablations=True)
    assert len(seen[-1]) == len(set(seen[-1])) == 5


@pytest.mark.slow
def test_what_breaks_each_first_is_found_out_where_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drums = tmp_path / "drums.toml"
    drums.write_text(DRUMS)
    monkeypatch.setattr(stress_module, "STRESS_ENSEMBLE", drums)
    monkeypatch.setattr(race_module, "STRESS_SCENARIOS", 2)
    words = [*QUICK, "--law", "nftsm", "--out", str(tmp_path / "race")]
    main(words)
    before = json.loads((tmp_path / "race" / "race.json").read_text())["entries"][0]
    assert before["stress"] is None
    main([*words, "--stress"])
    (entry,) = json.loads((tmp_path / "race" / "race.json").read_text())["entries"]
    assert [row["label"] for row in entry["stress"]] == ["winch drum radius"]
    assert entry | {"stress": None} == before, "nothing is tuned again"
    assert "<h2>Robustness margins" in (tmp_path / "race" / "report.html").read_text()


def test_an_interrupt_writes_what_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("dualwinch.toolboxes.race.race.race", lambda **_: replace(made_up(), remaining=2))
    with pytest.raises(SystemExit) as ended:
        main(["race", "--ensemble", "rig", "--out", str(tmp_path)])
    assert ended.value.code == 130
    assert (tmp_path / "race.json").exists()
    said = capsys.readouterr()
    assert "2 entries remain" in said.out
    assert "interrupted; the same call goes on with the entries that are not" in said.err.splitlines()[-1]


def test_an_ensemble_that_draws_gains_is_refused() -> None:
    drawn = loads_ensemble('[ensemble]\nname = "odd"\n[distributions]\ncontroller.nftsm.beta = { uniform = [1, 2] }\n')
    with pytest.raises(
        dw.ConfigurationError, match=r"controller\.nftsm\.beta: is drawn in 'odd'; a race needs fixed gains"
    ):
        dw.race(drawn)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--law", "adcr"), "unknown position law 'adcr'; did you mean 'adrc'"),
        (("--estimator", "kalmann"), "did you mean 'kalman'"),
        (("--coordination", "master"), "did you mean 'master-slave'"),
        (("--ensemble", "rigg"), "did you mean 'rig'"),
        (("--law", "nftsm", "--rollouts", "0"), "rollouts = 0: must be a whole number >= 1"),
        (("--law", "nftsm", "--test-scenarios", "1"), "test_scenarios = 1: must be a whole number >= 2"),
        (("--scenarios", "0"), "must be a whole number >= 1"),
        (("--seed", "-1"), "must be a whole number >= 0"),
        (("--method", "nsga2x"), "--method nsga2x: unknown method 'nsga2x'; did you mean 'nsga2'? Must be one of"),
        (("--set", "controller.kind=adrc"), "controller.kind=adrc: give --law"),
        (("--constraint", "worst.peak<=1"), "unknown metric 'peak'"),
        (("--set", "plant.vehicle.mas=1"), "did you mean 'plant.vehicle.mass'"),
    ],
)
def test_wrong_input_is_one_line(words: tuple[str, ...], message: str, tmp_path: Path, refused: Refused) -> None:
    assert message in refused("race --out", tmp_path, *words)
    assert list(tmp_path.iterdir()) == []
