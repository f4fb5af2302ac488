"""What a race keeps in its folder: entries that take part again on the same terms, and on no others."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.toolboxes.race.entries import earlier_entries
from dualwinch.toolboxes.race.result import RaceResult
from tests.toolboxes.race.made_up import TERMS, made_up


def write_race(folder: Path, race: RaceResult) -> None:
    (folder / "race.json").write_text(json.dumps(race.to_record()))


def test_entries_of_an_earlier_race_take_part_again(tmp_path: Path) -> None:
    assert earlier_entries(tmp_path, TERMS) == []
    race = made_up()
    again = replace(race.entries[0], entry=replace(race.entries[0].entry, search=1))
    write_race(tmp_path, replace(race, entries=(*race.entries, again)))
    entries = earlier_entries(tmp_path, TERMS)
    assert {entry.key: entry for entry in entries} == {each.entry.key: each.entry for each in (*race.entries, again)}
    commented = replace(TERMS, configuration=f"# a comment\n{TERMS.configuration}")
    assert earlier_entries(tmp_path, commented) == entries


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"seed": 2}, "contains a race with another seed, 5 and not 2; give another folder"),
        ({"rollouts": 400}, "with other rollouts, 3000 and not 400"),
        ({"configuration": "a = 2\n"}, "another configuration; give another folder"),
        ({"constraints": ()}, r"with other constraints, \['mean.chatter<=1\*paper'\] and not \(\)"),
    ],
)
def test_other_terms_are_refused(changed: dict[str, object], message: str, tmp_path: Path) -> None:
    write_race(tmp_path, made_up())
    with pytest.raises(ConfigurationError, match=message):
        earlier_entries(tmp_path, replace(TERMS, **changed))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("text", ["[]", "{", '{"entries": []}', json.dumps({"entries": [{"law": "adrc"}]})])
def test_what_is_no_race_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "race.json").write_text(text)
    with pytest.raises(ConfigurationError, match=r"race.json: is not the result of a race; remove it"):
        earlier_entries(tmp_path, TERMS)
