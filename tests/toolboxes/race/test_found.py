"""Ranking, rule and words of a race, from made-up numbers."""

import json
from dataclasses import replace

import pytest

from dualwinch.simulation.exogenous.signals import named_seed
from dualwinch.toolboxes.race.scores import EntryResult
from tests.toolboxes.race.made_up import made_up, scored

FOUND = made_up()
KEYS = {FOUND.names[scored.entry.key]: scored.entry.key for scored in FOUND.entries}


def test_the_least_error_is_first_and_who_does_not_differ_is_named() -> None:
    names = [FOUND.names[scored.entry.key] for scored in FOUND.ranking]
    assert names == ["adrc", "nftsm", "fando-nftsm", "fando-nftsm, constant observer gain"]
    assert FOUND.not_different(KEYS["adrc"]) == (KEYS["nftsm"],)
    assert FOUND.not_different(KEYS["fando-nftsm"]) == ()
    assert len(FOUND.pairs) == 6
    assert FOUND.ratios[KEYS["adrc"]].interval.estimate == pytest.approx(0.1, rel=0.1)


def test_a_pair_is_the_inverse_of_the_other_way_round() -> None:
    there, back = (FOUND.pair(*pair) for pair in ((KEYS["adrc"], KEYS["nftsm"]), (KEYS["nftsm"], KEYS["adrc"])))
    assert there.ratio.interval.estimate * back.ratio.interval.estimate == pytest.approx(1)
    assert there.corrected == back.corrected


def test_ablations_are_compared_with_the_whole_law() -> None:
    rows = {row[0]: row[1:] for row in FOUND.ablations()}
    assert set(rows) == {"without observer", "constant observer gain"}
    assert rows["constant observer gain"][0].startswith("1.4")
    assert {row[1] for row in rows.values()} == {"yes"}
    without = replace(FOUND, entries=tuple(each for each in FOUND.entries if not each.entry.variant))
    assert without.ablations() == [], "laws are laws where nobody asked for ablations"


def searched(*errors: float, law: str = "adrc") -> tuple[EntryResult, ...]:
    """Searches of one entry, by the errors they come to."""
    first = scored(law, 1.0)
    return tuple(
        replace(
            scored(law, error, variant=""),
            entry=replace(first.entry, search=search),
            search=replace(first.search, seconds=float(search)),
        )
        for search, error in enumerate(errors)
    )


def test_of_several_searches_the_median_counts() -> None:
    found = replace(FOUND, entries=(*searched(0.2, 0.1, 0.4), *searched(0.3, 0.5, law="nftsm")))
    assert [found.ratios[each.entry.key].interval.estimate for each in found.ranking] == pytest.approx(
        [0.2, 0.5], rel=0.1
    ), "of two the worse"
    assert [found.names[each.entry.key] for each in found.entries] == ["adrc"] * 3 + ["nftsm"] * 2
    assert found.search_spread == pytest.approx(4)
    assert "2 entries in 5 searches" in repr(found)
    assert "up to a factor of 4 apart" in repr(found)
    record = found.to_record()
    assert [len(entry["searches"]) for entry in record["entries"]] == [3, 2]
    assert len(found.search_rows()) == 5


def test_searches_that_overlap_do_not_differ_however_sure_their_medians_are() -> None:
    apart = replace(FOUND, entries=(*searched(0.2, 0.1, 0.15), *searched(0.3, 0.5, law="nftsm")))
    overlapping = replace(FOUND, entries=(*searched(0.2, 0.1, 0.4), *searched(0.3, 0.5, law="nftsm")))
    assert [found.pairs[0].corrected < 1e-9 for found in (apart, overlapping)] == [True, True]
    assert [found.pairs[0].differ for found in (apart, overlapping)] == [True, False]
    assert overlapping.not_different(overlapping.ranking[0].entry.key) == (overlapping.ranking[1].entry.key,)


def test_json_says_all_of_it() -> None:
    record = json.loads(json.dumps(FOUND.to_record(), allow_nan=False))
    assert [entry["name"] for entry in record["entries"]][:2] == ["adrc", "nftsm"]
    assert record["entries"][0]["not_different"] == [KEYS["nftsm"]]
    assert record["seeds"] == {"searches": 5, "test": named_seed(5, "benchmark test")}
    assert sum(pair["differ"] for pair in record["pairs"]) == 5
    lost = replace(FOUND, entries=(scored("adrc", 1.0, lost=40),)).to_record()
    assert json.loads(json.dumps(lost, allow_nan=False))["entries"][0]["over_paper"]["estimate"] is None
