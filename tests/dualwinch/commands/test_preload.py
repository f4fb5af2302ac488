"""``dualwinch preload`` as a user runs it."""

import json
from pathlib import Path

import pytest

import dualwinch as dw
from dualwinch.cli import main


def test_the_table_and_the_file_say_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "p.json", tmp_path / "p.svg"
    main(["preload", "--case", "4", "--out", str(out), "--plot", str(plot)])
    said = capsys.readouterr().out
    held = json.loads(out.read_text(), parse_constant=pytest.fail)
    assert [name for name in ("constant", "best_constant", "scheduled", "optimum") if name in held] == [
        "constant",
        "best_constant",
        "scheduled",
        "optimum",
    ]
    loads = {name: held[name]["metrics"]["continuous_load"] for name in ("constant", "best_constant", "scheduled")}
    for load in loads.values():
        assert f"{load:.4g}" in said
    assert f"The schedule takes {loads['scheduled'] / loads['best_constant']:.3g} of the continuous load" in said
    assert f"{100 * held['saved_share']:.3g} % of the possible saving" in said
    assert held["optimum"]["metrics"]["continuous_load"] == pytest.approx(38.72, abs=0.01)
    assert len(held["scheduled"]["curves"]["F1"]) == len(held["scheduled"]["curves"]["t"]) == 1000
    assert 'kind = "scheduled-preload"' in held["configuration"]
    assert plot.stat().st_size > 1000


@pytest.mark.parametrize("more", [(), ("--set", "controller.scheduled_preload.margin=0.025")])
def test_another_coordination_of_the_file_has_a_column_as_it_is(
    more: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "mine.toml", tmp_path / "p.json"
    file.write_text(
        '[controller.coordination]\nkind = "proportional-tension"\n[controller.proportional_tension]\n'
        "slow_time = 0.7\n[simulation]\nduration = 2.0\n"
    )
    main(["preload", "--config", str(file), *more, "--out", str(out)])
    said = capsys.readouterr().out
    held = json.loads(out.read_text(), parse_constant=pytest.fail)
    own = dw.simulate(dw.load(file))
    measured = {name: value for name, value in held["as_configured"]["metrics"].items() if value is not None}
    assert measured == pytest.approx({name: own.metrics[name] for name in measured}, rel=1e-12)
    assert held["as_configured"]["coordination"] == "proportional-tension"
    assert held["constant"]["coordination"] == "differential-tension"
    assert held["scheduled"]["coordination"] == "scheduled-preload"
    heading = next(line for line in said.splitlines() if "scheduled" in line)
    assert heading.index("configured") < heading.index("constant")
    assert (
        "as configured: proportional-tension, as `simulate` runs it; constant and best constant share the force by "
        "differential-tension, scheduled by scheduled-preload" in said
    )


def test_the_papers_coordination_has_no_second_column(capsys: pytest.CaptureFixture[str]) -> None:
    main(["preload", "--case", "4", "--set", "simulation.duration=2"])
    assert "as configured" not in capsys.readouterr().out


@pytest.mark.slow
def test_the_energy_decides_where_it_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    main(["preload", "--case", "2", "--minimise", "energy"])
    assert "of the energy of the best constant preload" in capsys.readouterr().out


def test_a_motion_beyond_the_motors_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["preload", "--case", "4", "--set", "controller.coordination.tension_max=4000"])
    assert stopped.value.code == 1
    assert "allow a larger error" in capsys.readouterr().err


@pytest.mark.slow
def test_a_loop_that_is_unstable_saves_nothing_and_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "preload.json"
    main(["preload", "--case", "4", "--set", "controller.observer.l0=3000", "--out", str(out)])
    printed = capsys.readouterr().out
    assert ": no saving." in printed
    assert "note: unstable at small amplitudes" in printed
    assert any(words.startswith("unstable at small amplitudes") for words in json.loads(out.read_text())["remarks"])
