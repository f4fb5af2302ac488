"""The benchmark commands' tables, figure and documents; what they time is not tested."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import growth
from benchmarks.document import duration, markdown, put
from benchmarks.growth import MANY, Point
from benchmarks.growth_figure import growth_figure
from benchmarks.startup import STAGES, _process
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CompilerNotFoundError


@pytest.fixture
def found() -> list[Point]:
    def point(series: str, value: float, rollouts: int, seconds: float) -> Point:
        return Point(series, value, rollouts, lambda: None, [seconds, 2 * seconds, 9.0])

    return [
        point("threads", 1, MANY, 0.2),
        point("threads", 2, MANY, 0.1),
        point("horizon", 50, 1, 0.01),
        point("hand C, horizon", 50, 1, 0.02),
        point("candidates", 64, 64, 0.064),
    ]


def test_rows_give_median_share_and_speed(found: list[Point]) -> None:
    table = growth.rows(found)
    assert table[0] == ["one rollout, C call alone, of 50 s", "20 ms", "20 ms", "2 500 ×"]
    assert table[2] == ["rollouts of 50 s in one call, 1 thread: 64", "128 ms", "2 ms", "25 000 ×"]


def test_the_figure_draws_every_series(found: list[Point]) -> None:
    figure = growth_figure(found)
    horizon, candidates, threads = figure.axes
    assert len(horizon.lines) == 2
    assert np.asarray(candidates.lines[0].get_ydata()) == pytest.approx([2.0])
    assert np.asarray(threads.lines[0].get_ydata()) == pytest.approx([MANY / 0.4, MANY / 0.2])


def test_points_run_once_a_round_and_the_first_call_does_not_count() -> None:
    calls: list[str] = []
    points = [Point(name, 1, 1, lambda name=name: calls.append(name)) for name in ("a", "b")]
    growth.measure(points, 2, lambda _: None)
    assert calls == ["a", "b"] * 3
    assert [len(point.seconds) for point in points] == [2, 2]


def test_a_table_goes_between_the_marks_of_its_document(tmp_path: Path) -> None:
    file = tmp_path / "doc.md"
    file.write_text("before\n<!-- growth: begin -->\nold\n<!-- growth: end -->\nafter\n")
    put(file, "growth", markdown(["a", "b"], [["x", duration(0.0123)]]))
    assert file.read_text() == (
        "before\n<!-- growth: begin -->\n| a | b |\n|---|--:|\n| x | 12.3 ms |\n<!-- growth: end -->\nafter\n"
    )
    with pytest.raises(ValueError, match="lacks the marks"):
        put(file, "startup", "")


def test_a_process_reports_its_stages_or_why_it_cannot(tmp_path: Path) -> None:
    try:
        command = find_compiler().command[0]
    except CompilerNotFoundError as missing:
        pytest.skip(str(missing))
    _, said = _process("stages", command, str(tmp_path))
    stages = json.loads(said)
    assert tuple(stages) == STAGES
    assert list(tmp_path.glob("*/*.so"))
    with pytest.raises(RuntimeError, match="no-such-compiler"):
        _process("run", "no-such-compiler", str(tmp_path))
