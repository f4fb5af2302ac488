"""Names of files, studies and parts are text, on terminals and in figures."""

from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from dualwinch.cli.app import main
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.ensembles.comparison import compare
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots import comparison, trajectory
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

NAMES = ["_first $x^2$ [red].toml", "second [/bold] $y$"]


def labels(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_brackets_in_a_file_name_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["simulate", "--set", "simulation.duration=0.1", "--out", "[red]run[bold].csv"])
    assert "[red]run[bold].csv" in capsys.readouterr().err.replace("\n", "")
    assert (tmp_path / "[red]run[bold].csv").exists()


def test_names_in_figures_are_no_formulas_and_none_is_left_out() -> None:
    sea = load_ensemble("sea")
    sea = replace(sea, name="a $sea$ of mine", experiment=override(sea.experiment, {"simulation.duration": 0.1}))
    found = comparison(compare(dict.fromkeys(NAMES, paper_controller()), sea, 3, 1))
    short = override(case(4), {"simulation.duration": 0.1})
    drawn = labels(found), labels(trajectory(dict.fromkeys(NAMES, simulate(short))))
    for words in drawn:
        shown = [word.replace("\u200b", "").replace(r"\$", "$") for word in words]
        assert set(NAMES) <= set(shown)
        assert not any("$" in word.replace(r"\$", "") for word in words if "first" in word or "second" in word)
    assert any(r"a \$sea\$ of mine" in text.get_text() for text in found.texts)
