"""The page about the paper's law, from a made-up race."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.race_page import claims_table, facts, main, race_table
from tests.toolboxes.race.made_up import made_up, scored

RACE = made_up().to_record()


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]


def test_claims_say_who_differs_and_what_was_not_run() -> None:
    rows = {row[1]: row[2:] for row in cells(claims_table(RACE))}
    assert rows["`pid-cascade`"] == ["–", "not run"]
    assert rows["`nftsm`"][1] == "better without"
    assert rows["`nftsm`"][0].startswith("0.199 (")
    assert rows["constant observer gain"][1] == "worse without"
    assert rows["constant observer gain"][0].startswith("1.4")
    assert rows["linear surface"] == ["–", "not run"]


def test_everybody_stands_in_the_table_with_the_papers_gains_last() -> None:
    rows = cells(race_table(RACE))
    assert [row[0] for row in rows] == [
        *("1. adrc", "2. nftsm", "3. fando-nftsm", "4. fando-nftsm, constant observer gain", "the paper's gains")
    ]
    assert [row[4] for row in rows][2:4] == ["violated: worst.peak_tension <= 6000 N", "satisfied"]
    assert [row[5] for row in rows] == ["2", "1", "–", "–", ""]
    assert facts(RACE).startswith(
        "*4 entries in `rig`, 4 searches of 3000 rollouts by `hybrid` (300 to 300 trials), 40 "
    )
    assert facts(RACE).endswith("seed 5.*")
    entry = made_up().entries[1]
    again = replace(scored("adrc", 0.2), entry=replace(entry.entry, search=1))
    several = replace(made_up(), entries=(*made_up().entries, again)).to_record()
    assert "5 searches of 3000 rollouts" in facts(several)
    assert "are up to a factor of 2 apart" in facts(several)


def test_every_block_of_a_page_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, page = tmp_path / "race", tmp_path / "page.md"
    folder.mkdir()
    (folder / "race.json").write_text(json.dumps(RACE))
    marks = ("claims", "race", "least error")
    page.write_text("".join(f"<!-- {mark}: begin -->\n<!-- {mark}: end -->\n" for mark in marks))
    monkeypatch.setattr(sys, "argv", ["race_page", str(folder), "--write", str(page)])
    main()
    text = page.read_text()
    for mark in marks:
        assert text.split(f"<!-- {mark}: begin -->")[1].split(f"<!-- {mark}: end -->")[0].strip()
