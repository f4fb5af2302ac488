"""The page about the paper says what its command computes."""

import re
from pathlib import Path

import pytest

from benchmarks.paper_claims import TABLES, claims
from benchmarks.paper_effects import CHOICES, facts, reduction
from dualwinch.toolboxes.paper.errata import NOTES

PAGE = Path(__file__).parents[2] / "docs" / "paper.md"


@pytest.mark.parametrize(
    "mark", [pytest.param(mark, marks=pytest.mark.slow if mark in {"choices", "claims"} else []) for mark in TABLES]
)
def test_the_page_is_what_the_command_writes(mark: str) -> None:
    found = re.search(
        rf"<!-- {mark}: begin -->\n(.*?)\n<!-- {mark}: end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    assert found is not None
    assert found[1] == TABLES[mark]()


def test_the_verdicts() -> None:
    verdicts = [claim.verdict for claim in claims()]
    assert [verdicts.count(each) for each in ("holds", "partly", "does not hold")] == [5, 2, 2]


def test_the_headline_follows_the_assumed_gains() -> None:
    shares = {choice.words: reduction(4, index) for index, choice in enumerate(CHOICES) if choice.note == "A9"}
    assert list(shares.values()) == pytest.approx([-55.8, -99.6], abs=0.05)
    assert reduction(4) == pytest.approx(-74.4, abs=0.05)
    assert reduction(3) == pytest.approx(-21.0, abs=0.05)


def test_every_note_has_an_effect() -> None:
    assert {note.id for note in NOTES} == {choice.note for choice in CHOICES} | set(facts())
