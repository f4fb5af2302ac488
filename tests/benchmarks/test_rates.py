"""The hand-written C loop is the same method; tables of rates and of dated results. What is timed is not tested."""

import json
from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from benchmarks.__main__ import Timed, ensemble_of, kernel, measure
from benchmarks.dated.__main__ import PAGE, RESULTS, tables
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


def test_calls_take_turns_and_the_first_round_does_not_count() -> None:
    order: list[str] = []
    calls = {name: Timed(name, lambda name=name: order.append(name)) for name in ("a", "b")}
    measure(calls, 2)
    assert order == ["a", "b"] * 3
    assert [len(each.seconds) for each in calls.values()] == [2, 2]


@pytest.mark.parametrize("page", [PAGE, "docs/fmu.md"])
def test_dated_tables_are_whole_and_stand_in_their_page(page: str) -> None:
    text = (Path(__file__).parents[2] / page).read_text(encoding="utf-8")
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert all(len(row) == len(each["headings"]) for each in results["tables"].values() for row in each["rows"])
    assert tables(results, page)
    for mark, block in tables(results, page).items():
        assert f"<!-- {mark}: begin -->\n{block}\n<!-- {mark}: end -->" in text
