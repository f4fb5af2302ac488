"""The report: complete, self-contained, and right about what it was not given."""

import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from docs.generated.errata import errata_markdown
from dualwinch.model.quantities.description import describe
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CONTROLLERS
from dualwinch.simulation.results.result import Result
from dualwinch.toolboxes.paper.errata import NOTES
from dualwinch.toolboxes.paper.report import summary, write_report

ROOT = Path(__file__).parents[3]
PNG = b"\x89PNG\r\n\x1a\n picture"
SVG = b"<?xml version='1.0'?><svg xmlns='http://www.w3.org/2000/svg'/>"
VERSIONS = {"dualwinch": "1.2.3", "casadi": "3.7.0"}
EMPTY = {"br", "col", "hr", "img", "input", "link", "meta", "wbr"}

Runs = dict[tuple[int, str], Result]


def render_report(
    runs: Runs, figures: dict[int, bytes], configuration: str, versions: dict[str, str], folder: Path
) -> str:
    write_report(folder / "page.html", runs, figures, configuration, versions)
    return (folder / "page.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def runs(paper_run: Callable[[int, str], Result]) -> Runs:
    return {(number, kind): paper_run(number, kind) for number in (1, 4) for kind in CONTROLLERS}


class Page(HTMLParser):
    """Collects text, bold text, pictures and links; fails on tags that do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.bold: list[str] = []
        self.words = ""
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        assert not [name for name in given if name.startswith("on")], "a script in an attribute"
        assert tag not in {"script", "link", "iframe", "object", "embed"}
        self.ids.add(given.get("id", ""))
        if "src" in given:
            self.sources.append(given["src"])
        if "href" in given:
            self.links.append(given["href"])
        if tag == "b":
            self.bold.append("")
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words += data
        if "b" in self.open:
            self.bold[-1] += data


def test_report_is_complete_and_self_contained(runs: Runs, tmp_path: Path) -> None:
    figures = {5: SVG, 8: PNG, 18: SVG, 21: PNG}
    path = tmp_path / "report.html"
    write_report(path, runs, figures, "[plant]\nrope_slack = true  # <b>A2</b> & more\n", VERSIONS)
    assert list(tmp_path.iterdir()) == [path]
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert len(page.sources) == 4
    assert all(source.startswith(("data:image/png;base64,", "data:image/svg+xml;base64,")) for source in page.sources)
    outside = [link for link in page.links if not link.startswith("#")]
    assert set(outside) == {"https://doi.org/10.3390/jmse13061120"}
    assert {link[1:] for link in page.links if link.startswith("#")} <= page.ids
    assert {"figure-5", "figure-8", "figure-18", "figure-21"} <= page.ids
    assert not re.search(r"url\(|@import|<script", text)
    for note in NOTES:
        assert note.id in page.words
        assert note.here in page.words
    assert "rope_slack = true  # <b>A2</b> & more" in page.words
    assert "1.2.3" in page.words
    assert "a step in speed, which no winch can follow" in page.words
    assert "the lines of FANDO-NFTSM and NFTSM coincide" in page.words
    assert "converges faster than the PID cascade" in page.words
    assert "does not hold" in page.words


def test_table_shows_numbers_and_marks_the_best(runs: Runs, tmp_path: Path) -> None:
    page = Page(render_report(runs, {}, "", VERSIONS, tmp_path))
    for expected in ("3.72", "28.4", "27300", "7980", "16.1"):
        assert expected in page.words
    assert "3.72" in page.bold
    assert "14.5" not in page.bold
    assert page.bold.count("16.2") == 2, "FANDO-NFTSM and NFTSM are the same in Case 1"
    assert page.bold.count("200") == 2, "the best smallest tension is the largest one"


def test_summary_puts_the_paper_beside_what_was_measured(runs: Runs) -> None:
    words = summary(runs).replace("\N{NO-BREAK SPACE}", " ")
    assert words.startswith("6 simulated runs of the paper's Cases 1 and 4, under FANDO-NFTSM,")
    assert "mean |e| by −74.4 %, max |e| by −77.4 % and mean e² by −93.8 %" in words
    assert words.endswith("the paper reports −76 %, −67 % and −93.5 %.")


def test_one_run_is_enough(runs: Runs, tmp_path: Path) -> None:
    alone = {(4, "nftsm"): runs[4, "nftsm"]}
    page = Page(render_report(alone, {18: SVG}, "", VERSIONS, tmp_path))
    assert "1 simulated run of the paper's Case 4, under NFTSM." in page.words
    assert "paper: −76" not in page.words
    assert "comparison" not in page.ids
    assert "#comparison" not in page.links
    assert page.bold == ["Figure 18."], "nothing to compare, nothing is best"


def test_a_run_that_diverged_is_said_so_and_never_best(runs: Runs, tmp_path: Path) -> None:
    nothing = dict.fromkeys(("steady_mae", "steady_max_abs_error", "steady_mse"), np.nan)
    metrics = replace(runs[4, "pid-cascade"].metrics, mae=1e-9, max_abs_error=np.inf, **nothing)
    bad = replace(runs[4, "pid-cascade"], outcome="left_track", end_time=1.468, metrics=metrics)
    page = Page(render_report(runs | {(4, "pid-cascade"): bad}, {}, "", VERSIONS, tmp_path))
    assert "left track at 1.47 s" in page.words
    assert "1.37" in page.bold
    assert "–" in page.words


def test_reports_are_the_same_every_time(runs: Runs, tmp_path: Path) -> None:
    first, second = (render_report(runs, {21: PNG}, "a", VERSIONS, tmp_path) for _ in range(2))
    assert first == second


def test_errata_table_is_complete_and_true() -> None:
    ids = [note.id for note in NOTES]
    assert ids == [f"E{number}" for number in range(1, 12)] + [f"A{number}" for number in range(1, 16)]
    keys = describe(Experiment)
    for note in NOTES:
        assert note.kind == ("erratum" if note.id.startswith("E") else "assumption")
        assert note.keys or note.modules
        for key in note.keys:
            assert key in keys or any(known.startswith(key + ".") for known in keys), key
        for module in note.modules:
            assert (ROOT / module).is_file(), module


def test_errata_document_is_the_table() -> None:
    assert (ROOT / "docs" / "errata.md").read_text(encoding="utf-8") == errata_markdown()
