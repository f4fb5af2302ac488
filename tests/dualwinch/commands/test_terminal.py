"""Names of files, studies and parts are text, on terminals and in figures, and break where they may."""

from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from rich.console import Console

from dualwinch.cli.app import main
from dualwinch.cli.output import table_of_rows
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.quantities.figures import FigureColumn, FigureTable
from dualwinch.plots import comparison, trajectory
from dualwinch.simulation.ensembles.comparison import compare
from dualwinch.simulation.paper import case
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


@pytest.mark.parametrize(
    ("width", "lines"),
    [
        (60, "estimator.encoder_1.errors.estimate.0 (1)|observer.e2_previous 97.5 %, x 2.5 %"),
        (24, "estimator.encoder_1.|errors.estimate.0 (1)|observer.e2_previous|97.5 %, x 2.5 %"),
        (20, "estimator.encoder_1.|errors.estimate.0|(1)|observer.e2_previous|97.5 %, x 2.5 %"),
        (10, "estimator.|encoder_1.|errors.|estimate.0|(1)|observer.|e2_|previous|97.5 %,|x 2.5 %"),
    ],
)
def test_names_in_tables_break_behind_dots_and_rather_not_behind_underscores(width: int, lines: str) -> None:
    rows = [["estimator.encoder_1.errors.estimate.0 (1)"], ["observer.e2_previous 97.5 %, x 2.5 %"]]
    file = StringIO()
    Console(width=width + 2, file=file).print(table_of_rows(FigureTable("modes", [FigureColumn("mode", "")], rows)))
    body = file.getvalue().rpartition("─")[2]
    assert [line.strip() for line in body.splitlines() if line.strip()] == lines.split("|")
