"""The page about the paper says what its command computes."""

import re
from pathlib import Path

import pytest

from benchmarks.paper_claims import FAILS, HOLDS, PARTLY, TABLES, claims, settling_time
from benchmarks.paper_effects import CHOICES, LAW, facts, reduction
from dualwinch.reports.errata import NOTES

PAGE = Path(__file__).parents[2] / "docs" / "paper.md"


@pytest.mark.parametrize("mark", TABLES)
def test_the_page_is_what_the_command_writes(mark: str) -> None:
    found = re.search(
        rf"<!-- {mark}: begin -->\n(.*?)\n<!-- {mark}: end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    assert found is not None
    assert found[1] == TABLES[mark]()


def test_the_verdicts() -> None:
    verdicts = [claim.verdict for claim in claims()]
    assert (verdicts.count(HOLDS), verdicts.count(PARTLY), verdicts.count(FAILS)) == (6, 2, 2)


def test_the_pid_cascade_is_first_within_a_fifth_of_a_metre_in_case_1() -> None:
    assert settling_time(1, "pid-cascade", 0.2) == pytest.approx(11.67, abs=0.01)
    assert settling_time(1, LAW, 0.2) == pytest.approx(16.92, abs=0.01)
    assert settling_time(1, "pid-cascade", 0.1) is None


def test_the_headline_follows_the_assumed_gains() -> None:
    shares = {choice.words: reduction(4, index) for index, choice in enumerate(CHOICES) if choice.note == "A9"}
    assert list(shares.values()) == pytest.approx([-55.8, -99.6], abs=0.05)
    assert reduction(4) == pytest.approx(-74.4, abs=0.05)
    assert reduction(3) == pytest.approx(-21.0, abs=0.05)


def test_every_note_has_an_effect() -> None:
    assert {note.id for note in NOTES} == {choice.note for choice in CHOICES} | set(facts())
