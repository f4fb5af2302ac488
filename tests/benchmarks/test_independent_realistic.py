"""The table of effects: what it makes of runs, that an effect is one, and that each machine has its own."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from benchmarks.independent.judge import SAMPLES, Conditions, Judge, Runs
from benchmarks.independent.overloads import FAULTS, LATE, OVERLOADS, TENSIONS, judged, table
from benchmarks.independent.realistic import ON_SITE, Verdict, main, rows
from benchmarks.independent.site import EFFECTS, draw
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.experiment import Experiment

STILL = Conditions(outage_length=0.0)


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    return Judge(Experiment(controller=paper_controller()), tmp_path_factory.mktemp("paper"))


def test_a_machine_has_the_same_share_of_an_effect_whichever_others_it_has() -> None:
    alone = draw(7, ("gearbox",))
    assert draw(7, tuple(EFFECTS)).items() >= alone.items()
    assert draw(8, ("gearbox",)) != alone
    assert set(ON_SITE["all"]) == set(EFFECTS)


@pytest.mark.parametrize("winch", ["rig", "site"])
def test_every_row_sets_what_the_machine_knows(paper: Judge, winch: str) -> None:
    for settings in rows(winch, 120.0).values():
        at_once = {**settings(1), "give_up": 1e-9}
        assert paper.run(STILL, [1], lambda _, at_once=at_once: at_once).samples[0] < 100


@pytest.mark.parametrize("effects", [OVERLOADS, FAULTS, LATE], ids=["overloads", "faults", "late"])
def test_every_overload_is_one_that_the_machine_knows(paper: Judge, effects: Mapping[str, Mapping[str, float]]) -> None:
    """What a filter is told, the paper's controller does not have."""
    rows = judged({"paper": (paper, 120.0)}, [1], effects, settings={"give_up": 1e-9})
    assert rows.keys() == effects.keys()
    assert all(runs["paper"].samples[0] < 100 for runs in rows.values())
    assert table(rows, TENSIONS).count("\n") == len(effects) + 1


def test_what_the_machine_does_not_know_is_refused(paper: Judge) -> None:
    with pytest.raises(ValueError, match=r"rope_colour=1\.0: no such effect or parameter"):
        paper.run(STILL, [1], lambda _: {"rope_colour": 1.0})


@pytest.mark.slow
def test_the_implicit_method_goes_where_the_explicit_one_does(paper: Judge) -> None:
    """Paper's gains and a little mass in the ropes: RMS errors with half the step, and of the plant without mass."""
    coarse, fine, none = (
        float(paper.run(STILL, [101], lambda _, given=given: given).mse[0] ** 0.5)
        for given in ({"rope_mass": 0.1}, {"rope_mass": 0.1, "substeps": 32}, {"slack_below": 1e-9})
    )
    assert coarse == pytest.approx(fine, rel=1e-3)
    assert coarse == pytest.approx(none, rel=0.01)


@pytest.mark.slow
def test_the_papers_gains_hold_with_rope_mass_and_not_on_a_real_winch(paper: Judge) -> None:
    seeds = [3, 4, 5]
    none, light, real = (
        Verdict.of(paper.run(STILL, seeds, rows("rig", 0.0)[row]))
        for row in ("nothing", "rope mass, 2.36 kg/m", "drum inertia 220 kg m²")
    )
    assert (light.lost, light.rms) == (0, pytest.approx(none.rms, rel=0.03))
    assert real.failed == 3
    assert real.rms > 100.0
    damped = Verdict.of(paper.run(STILL, seeds, rows("site", 250.0)["rope mass and its damping"]))
    assert (damped.lost, damped.rms) == (0, pytest.approx(none.rms, rel=0.3))


def test_a_verdict_counts_the_slack_the_long_slack_and_the_lost() -> None:
    numbers = {
        "samples": [SAMPLES, SAMPLES, SAMPLES, 100],
        "slack": [0, 3, 400, 0],
        "mse": [1e-8, 4e-8, 9e-8, 1.0],
        "peak_tension": [5000.0, 5100.0, 5200.0, 9000.0],
    }
    runs = Runs(**{field: np.array(numbers.get(field, [0.0] * 4), float) for field in Runs.__dataclass_fields__})
    verdict = Verdict.of(runs)
    assert (verdict.failed, verdict.slack_long, verdict.lost) == (3, 2, 1)
    assert verdict.rms == pytest.approx(0.25)
    assert verdict.cells()[0] == "0.250"


def test_the_command_prints_a_row_and_keeps_the_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = tmp_path / "found.json"
    assert main(["--machines", "1", "--row", "nothing", "--json", str(kept), "--seed", "3"]) == 0
    assert "| nothing | 0." in capsys.readouterr().out
    found = json.loads(kept.read_text())
    assert found["seeds"] == [3]
    assert len(found["rows"]["nothing"]["paper"]["mse"]) == 1
