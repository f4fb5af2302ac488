"""``dualwinch linearise --loop closed`` and ``--loop open`` as a user runs them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.cli import main
from dualwinch.simulation.paper import case
from tests.tiers import all_but


def test_margins_are_printed_and_the_cut_loop_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "loop.json", tmp_path / "bode.svg"
    main(["linearise", "--loop", "open", "--v", "0.5", "--out", str(out), "--plot", str(plot)])
    said = capsys.readouterr().out
    system = linear_open_loop(case(2), 25.0, 0.5)
    found = margins(system)
    for number in (found.gain, found.phase, 1e3 * found.delay, found.disk):
        assert f"{number:.4g}" in said
    assert "by amplitude of the speed error" in said
    held = json.loads(out.read_text())
    assert np.array_equal(np.array(held["A"]), system.A)
    assert (held["inputs"], held["outputs"], held["dt"]) == (["u_in"], ["u_out"], 1e-3)
    assert (held["operating_point"]["x"], held["operating_point"]["v"]) == (25, 0.5)
    assert plot.stat().st_size > 1000


@pytest.mark.slow
def test_both_torques_can_be_cut_as_margins_of_a_tuning_say_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["linearise", "--loop", "open", "--opening", "torques", "--v", "0.5", "--plot", str(tmp_path / "bode.svg")]
    main([*words, "--out", str(tmp_path / "loop.json")])
    said = capsys.readouterr().out
    assert "margins of the loop opened at torques (tau_1_out/tau_1_in, tau_2_out/tau_2_in)" in said
    assert f"{1e3 * margins(linear_open_loop(case(2), 25.0, 0.5, 'torques')).delay:.4g}" in said
    assert "by amplitude of the speed error" in said
    assert json.loads((tmp_path / "loop.json").read_text())["inputs"] == ["tau_1_in", "tau_2_in"]
    main([*words[:-1], str(tmp_path / "a.svg"), "--figure", "amplitude"])


def test_the_closed_loop_is_told_stable_and_swept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["linearise", "--loop", "closed", "--v", "0.5", "--plot", str(tmp_path / "poles.svg")])
    assert ": stable" in capsys.readouterr().out
    main(["linearise", "--loop", "closed", "--sweep", "preload=1000:3000:1000", "--out", str(tmp_path / "all.json")])
    assert capsys.readouterr().out.count("0.99") >= 3
    main(["linearise", "--loop", "open", "--sweep", "x=5:45:20", "--plot", str(tmp_path / "bodes.svg")])
    main(["linearise", "--loop", "open", "--plot", str(tmp_path / "a.svg"), "--figure", "amplitude"])


def test_an_unstable_loop_has_its_verdict_and_no_margins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "loop.json"
    shaken = ["linearise", "--loop", "open", "--v", "0.5", "--set", "controller.nftsm.smoothing=1e-7"]
    main([*shaken, "--out", str(out)])
    lines = capsys.readouterr().out.partition("by amplitude")[0].splitlines()
    (printed,) = {line for line in lines if "UNSTABLE" in line}
    assert printed.split() == [*"–––––––", "UNSTABLE"]
    figures = json.loads(out.read_text())["figures"]
    (row,) = figures["margins"]["rows"]
    assert not row.pop("stable")
    growing = row.pop("growing_mode")
    assert growing in lines
    assert re.fullmatch(r"deviations grow by \S+ 1/s at \S+ Hz, both drums together", growing)
    assert set(row.values()) == {None}
    by_amplitude = figures["margins_by_amplitude"]["rows"]
    assert {row["stable"] for row in by_amplitude} == {True, False}
    assert all((row[name] is None) != row["stable"] for row in by_amplitude for name in ("gain", "delay", "disk"))


@pytest.mark.slow
def test_unstable_modes_come_first_and_every_name_is_whole_and_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    late = ("--set", "simulation.delay_samples=40", "--set", "controller.estimator=self-calibrating-kalman")
    main(["linearise", "--loop", "closed", *late, "--out", str(tmp_path / "loop.json")])
    said = capsys.readouterr().out
    assert "…" not in said
    rows = json.loads((tmp_path / "loop.json").read_text())["figures"]["modes"]["rows"]
    unstable = [row["unstable"] for row in rows]
    assert unstable == sorted(unstable, reverse=True)
    assert unstable[0] == (rows[0]["remark"] == "unstable") == (rows[0]["damping"] < 0)
    assert unstable[0]
    table = said.partition("\nmodes")[2].partition("\nparticipation")[0]
    assert table.count("unstable") == sum(unstable)
    assert not any("information" in row["mode"] for row in rows)
    names = [row["mode"] for row in rows]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("loop", all_but(["open"], ["closed", "open"]))
def test_what_a_filter_learns_of_the_ropes_is_held(
    loop: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, held = tmp_path / "loop.json", "what the estimator learns of the machine is held"
    main(["linearise", "--loop", loop, "--estimator", "calibrating-kalman", "--out", str(out)])
    assert held in capsys.readouterr().out
    assert not [name for name in json.loads(out.read_text())["states"] if "excess" in name]
    main(["linearise", "--loop", loop, "--estimator", "kalman"])
    assert held not in capsys.readouterr().out
