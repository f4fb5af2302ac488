import json
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.controllers.limits import Limits
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.plots.page import encode
from dualwinch.toolboxes.stress.imperfections import ImperfectionSize
from dualwinch.toolboxes.stress.limits import SHARE
from dualwinch.toolboxes.stress.result import StressResult
from dualwinch.toolboxes.stress.stress import breakdowns
from dualwinch.tuning.constraints import constraints_from
from tests.toolboxes.stress.ensembles import of, sea

TEXT = """
[distributions]
plant.winch_1.radius_error = { uniform = [-2e-3, 2e-3] }
plant.winch_2.radius_error = { uniform = [-1e-3, 1e-3] }
sensors.position_bias = { uniform = [0, 2e-3] }
[sensors]
encoder_counts = 1024
[plant.vehicle]
added_mass = 4e3
"""


@pytest.fixture(scope="module")
def found() -> StressResult:
    base = sea()
    own = {"paper": paper_controller(), "a|b.toml": replace(paper_controller(), limits=Limits(preload=3e3))}
    constraints = constraints_from(["worst.peak_tension<=1", "worst.mse<=1.05*paper"], base.experiment)
    return breakdowns(own, base, of(TEXT, base), constraints, scenarios=3, seed=0)


def test_the_table_is_markdown_and_begins_with_what_breaks_first(found: StressResult) -> None:
    lines = [line for line in repr(found).splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(found.rows)
    assert len({len(line) for line in lines}) == 1
    assert {line.replace("\\|", "").count("|") for line in lines} == {7}
    assert "a\\|b.toml breaks at" in lines[0]
    sizes = [row.margins["a|b.toml"].order for row in found.ranking]
    assert sizes == sorted(sizes)
    html = found._repr_html_()
    assert "winch radius error" in html
    assert "&gt;" in html


def test_amounts_are_those_of_the_value_that_goes_furthest(found: StressResult) -> None:
    _, rows = found.table()
    assert {row[0]: row[1] for row in rows} == {
        "winch radius error": "±0.2 %",
        "position bias": "0 to 2 mm",
        "encoder counts": "1024",
        "vehicle added mass": "4000 kg",
        "all together": "",
    }


def test_the_record_says_what_the_result_does(found: StressResult) -> None:
    record = json.loads(json.dumps(found.to_record(), allow_nan=False))
    assert [row["label"] for row in record["imperfections"]] == [row.imperfection.label for row in found.ranking]
    assert [gains["name"] for gains in record["gains"]] == ["paper", "a|b.toml"]
    by_label = {row["label"]: row for row in record["imperfections"]}
    drums = by_label["winch radius error"]
    assert drums["keys"] == ["plant.winch_1.radius_error", "plant.winch_2.radius_error"]
    assert drums["in_ensemble"] == {
        "low": -2e-3,
        "high": 2e-3,
        "unit": "1",
        "drawn": True,
        "text": "±0.2 %",
        "nominal": 0.0,
    }
    for row, kept in zip(found.ranking, record["imperfections"], strict=True):
        for name, margin in row.margins.items():
            assert kept["margins"][name]["size"] == margin.size
            violated = kept["margins"][name]["violated"]
            assert [each["name"] for each in violated] == [each.name for each in margin.violated]
            if margin.size and row.imperfection.label == "vehicle added mass":
                assert kept["margins"][name]["amount"]["high"] == pytest.approx(4e3 * margin.size)


def test_the_figure_has_a_row_for_each_imperfection(found: StressResult) -> None:
    figure = found.plot()
    (axes,) = figure.axes
    labels = [text.get_text() for text in axes.get_yticklabels()]
    assert labels == [
        "  ".join(filter(None, (row.imperfection.label, str(found.amount(row, 1.0) or "")))) for row in found.ranking
    ]
    drawn = {round(float(np.asarray(line.get_xdata())[0]), 9) for line in axes.lines if line.get_marker() == "o"}
    sizes = {margin.size for row in found.rows for margin in row.margins.values() if margin.size}
    assert sizes
    assert drawn == {round(size, 9) for size in sizes}
    assert encode(figure, ".svg") == encode(found.plot(), ".svg")


@pytest.mark.parametrize(
    ("amount", "words"),
    [
        (ImperfectionSize(-2e-3, 2e-3, "m", drawn=True), "±2 mm"),
        (ImperfectionSize(-2e-6, 2e-6, "m", drawn=True), "±2 µm"),
        (ImperfectionSize(-2.5, 2.5, "m", drawn=True), "±2.5 m"),
        (ImperfectionSize(-1.5e-5, 1.5e-5, SHARE, drawn=True), "±0.0015 %"),
        (ImperfectionSize(-0.1, 0.3, "N", drawn=True), "−0.1 to 0.3 N"),
        (ImperfectionSize(-900.0, 0.0, "N s/m", drawn=True, nominal=1000.0), "100 to 1000 N s/m"),
        (ImperfectionSize(-900.0, 900.0, "N s/m", drawn=True, nominal=1000.0), "±900 N s/m"),
        (ImperfectionSize(4096, 4096, "1", drawn=False), "4096"),
        (ImperfectionSize(5e-5, 5e-5, "s", drawn=False), "50 µs"),
        (ImperfectionSize(None, None, "", drawn=False, text="motor"), "motor"),
    ],
)
def test_amounts_in_words(amount: ImperfectionSize, words: str) -> None:
    assert str(amount) == words
