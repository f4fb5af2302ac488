"""What notebooks and prompts show: read back by an HTML parser, as a browser would."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.plant_points import linearise


class Reader(HTMLParser):
    """Rows of cells, all text, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(text)
        assert self.tags == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert {name for name, _ in attrs} <= {"style", "open"}
        assert all(value in {None, "text-align:left", "text-align:right", ""} for _, value in attrs), "no hard colours"
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in {"td", "th"}:
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.tags.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if self.tags[-1] in {"td", "th"}:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def run() -> Result:
    return simulate(override(case(4), {"simulation.duration": 0.2}))


def test_a_result_is_a_line_of_text(run: Result) -> None:
    text = repr(run)
    assert text.startswith("Result(FANDO-NFTSM: completed at 0.2 s, 200 rows of 24 columns; mse ")
    assert f"max_abs_error {run.metrics.max_abs_error:.4g} m;" in text
    assert len(text) < 160
    assert "\n" not in text
    ended = replace(run, outcome="left_track", metrics=replace(run.metrics, mse=np.nan))
    assert "left track at 0.2 s" in repr(ended)
    assert "mse" not in repr(ended)


def test_a_result_in_a_notebook_has_figures_of_merit_and_columns(run: Result) -> None:
    read = Reader(run._repr_html_())
    rows = {row[0]: row[1:] for row in read.rows}
    assert read.text.startswith("FANDO-NFTSM: completed at 0.2 s, 200 rows of 24 columns")
    assert rows["mse"] == [f"{run.metrics.mse:.5g}", "m²", "mean e², whole run"]
    assert rows["steady_mse"][0] == "–"
    assert rows["saturated_share"][1] == ""
    low, high = f"{run['F1'].min():.4g}", f"{run['F1'].max():.4g}"
    assert rows["F1"] == [low, high, "N", "tension of rope 1"]
    assert set(run) < set(rows)


def test_what_is_shown_is_escaped_and_may_be_empty(run: Result) -> None:
    columns = {"t": np.zeros(0), "<b>&": np.zeros(0)}
    odd = replace(run, columns=columns, quantities={"t": Quantity("s", ""), "<b>&": Quantity("1", "<script>")})
    read = Reader(odd._repr_html_())
    assert ["<b>&", "–", "–", "", "<script>"] in read.rows
    assert "script" not in re.findall(r"<(\w+)", odd._repr_html_())


def test_a_linear_system_shows_its_matrix_with_names() -> None:
    plant = linearise(x=10, v=1.8)
    read = Reader(plant._repr_html_())
    header = read.rows[0]
    assert header == ["", *plant.states, *plant.inputs]
    body = read.rows[1 : 1 + len(plant.states) + len(plant.outputs)]
    assert [row[0] for row in body] == [*(f"d{name}/dt" for name in plant.states), *plant.outputs]
    numbers = np.array([[float(cell) for cell in row[1:]] for row in body])
    assert numbers == pytest.approx(np.block([[plant.A, plant.B], [plant.C, plant.D]]), rel=1e-3)
    assert "continuous time, 6 states" in read.text
    assert "x = 10" in read.text


def test_a_large_linear_system_shows_its_names_alone() -> None:
    loop = linear_closed_loop(case(4), 1.0, 0.1)
    read = Reader(loop._repr_html_())
    assert "sampled every 0.001 s" in read.text
    assert [row[0] for row in read.rows[1:]] == [*loop.states, *loop.inputs, *loop.outputs]
    assert max(map(len, read.rows)) == 3
