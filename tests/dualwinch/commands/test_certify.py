"""``dualwinch certify`` as a user runs it."""

import json
from pathlib import Path

import pytest

from dualwinch.cli import main


def test_the_report_says_what_fails_and_the_file_holds_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, plot = tmp_path / "c.json", tmp_path / "v.svg"
    main(["certify", "--case", "4", "--out", str(out), "--plot", str(plot)])
    said = capsys.readouterr().out
    assert "Not certified: 2 of the paper's 5 conditions fail; with real ropes, 2 more (4 of the 7 rows above)." in said
    theorem, _, rule = said.partition("drums' resonance")
    verdicts = [line.split()[-1] for line in theorem.splitlines() if line.split()[-1:] in (["holds"], ["fails"])]
    assert (verdicts.count("holds"), verdicts.count("fails")) == (3, 4)
    assert "the force never saturates in this run" in said
    held = json.loads(out.read_text())
    assert held["certified"] is False
    assert held["conditions"][0]["left"] == 0.5
    assert rule.count("holds") == len(held["resonance"]["rows"]) == 12
    assert "stable up to speed errors of 30 cm/s" in rule
    assert held["large_signal"]["rows"][0]["amplitude"] == 0.3
    assert held["resonance"]["units"]["mass"] == "kg"
    assert held["nearby_gains"]["changes"]["controller.auxiliary.gamma"]["tried"] == 12000
    assert f"V decreases over {100 * held['decreasing_share']:.4g} %" in said
    assert len(held["curves"]["V"]) == len(held["curves"]["t"]) == 2000
    assert plot.stat().st_size > 1000


def test_a_diverging_run_is_reported_and_its_file_is_valid_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "c.json"
    main(["certify", "--case", "1", "--set", "controller.auxiliary.gamma=12000", "--out", str(out)])
    assert "Not certified: the run did not reach its end." in capsys.readouterr().out
    assert json.loads(out.read_text(), parse_constant=pytest.fail)["outcome"] == "diverged"
