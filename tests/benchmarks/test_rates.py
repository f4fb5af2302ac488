"""The hand-written C loop is the same method; tables of rates and of dated results. What is timed is not tested."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from benchmarks.__main__ import Timed, ensemble_of, kernel, measure, table
from benchmarks.dated.__main__ import RESULTS, tables
from benchmarks.document import markdown, put
from benchmarks.hand_c import MissingCompilerError, hand_adaptive

SHORT = {"simulation.duration": 0.5}


@pytest.mark.parametrize(("number", "substeps", "least_slack"), [(4, 5, 0.0), (3, 5, 0.01), (3, 8, 0.01)])
def test_the_loop_by_hand_computes_the_same_run(number: int, substeps: int, least_slack: float) -> None:
    """In Case 3 the speed step slackens rope 2 for some milliseconds."""
    experiment = dw.override(dw.case(number), SHORT | {"simulation.substeps": substeps})
    result = dw.simulate(experiment)
    try:
        positions, metrics = hand_adaptive(experiment)()
    except MissingCompilerError as missing:
        pytest.skip(str(missing))
    assert np.abs(positions[:-1] - result["x"][1:]).max() < 1e-11
    assert positions[-1] == pytest.approx(result.final_state["motion.plant.x"], abs=1e-11)
    assert metrics.mse == pytest.approx(result.metrics.mse, rel=1e-6)
    assert metrics.slack_share == result.metrics.slack_share >= least_slack


def test_the_compiled_code_of_an_ensemble_can_be_called_again() -> None:
    call = kernel(ensemble_of("sea", 0.1).chosen(range(20), 7), 1)
    assert call() is True
    assert call() is True


def timed(**seconds: float) -> dict[str, Timed]:
    return {name.replace("_", "-"): Timed(name, lambda: None, seconds=[value]) for name, value in seconds.items()}


@pytest.mark.parametrize(("features", "verdicts"), [(("avx512f", "avx2"), ["no", "no"]), (("avx2",), ["no", "yes"])])
def test_rates_stand_beside_their_targets(features: tuple[str, ...], verdicts: list[str]) -> None:
    calls = timed(hand=8.0, run=9.0, slopes=30.0, batch_1=1.25, batch_2=0.5, sea=2.0, rig=1.9)
    calls |= timed(sea_kernel=2.0, sea_whole=2.5, rig_kernel=2.0, rig_whole=2.7)
    rows = [[cell.strip() for cell in line.split("|")[3:-1]] for line in table(calls, features, 2).splitlines()[2:]]
    assert [row[1] for row in rows] == ["0.89 ×", "0.30 ×", "6.40 ×", "2.50 ×", "0.62 ×", "0.66 ×", "0.80 ×", "0.74 ×"]
    assert [rows[0][3], rows[2][3]] == verdicts
    assert [row[3] for row in rows[3:]] == ["yes", "no", "yes", "yes", "no"]


def test_calls_take_turns_and_the_first_round_does_not_count() -> None:
    order: list[str] = []
    calls = {name: Timed(name, lambda name=name: order.append(name)) for name in ("a", "b")}
    measure(calls, 2)
    assert order == ["a", "b"] * 3
    assert [len(each.seconds) for each in calls.values()] == [2, 2]


def test_dated_tables_are_whole_and_stand_in_their_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert all(len(row) == len(each["headings"]) for each in results["tables"].values() for row in each["rows"])
    for mark, text in tables(results).items():
        block = re.search(rf"<!-- {mark}: begin -->\n(.*?)\n<!-- {mark}: end -->", page, re.DOTALL)
        assert block
        assert block[1] == text


def test_a_table_goes_between_the_marks_of_its_document(tmp_path: Path) -> None:
    file = tmp_path / "doc.md"
    file.write_text("before\n<!-- rates: begin -->\nold\n<!-- rates: end -->\nafter\n")
    put(file, "rates", markdown(["a", "b"], [["x", "1"]]))
    assert file.read_text() == (
        "before\n<!-- rates: begin -->\n| a | b |\n|---|--:|\n| x | 1 |\n<!-- rates: end -->\nafter\n"
    )
    with pytest.raises(ValueError, match="lacks the marks"):
        put(file, "startup", "")
