"""What a race keeps: files that are gone on with on the same terms, and on no others."""

from pathlib import Path
from typing import Any, cast

import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.toolboxes.race import race
from dualwinch.toolboxes.race.entries import BenchmarkEntry
from dualwinch.toolboxes.race.race import RaceJob, ResultFolder

TERMS = {"seed": 1, "rollouts": 300, "configuration": "a = 1\nb = 2\n", "constraints": ("x<=1",)}


def test_what_is_kept_comes_back_to_the_bit(tmp_path: Path) -> None:
    ResultFolder(tmp_path, TERMS).keep("adrc", {"space": (1, 2)}, {"value": 0.1 + 0.2})
    again = ResultFolder(tmp_path, TERMS)
    assert again.stems == ("adrc",)
    assert again.find("adrc", {"space": (1, 2)}) == {"value": 0.1 + 0.2}
    assert again.find("nftsm") is None
    assert [file.name for file in (tmp_path / "entries").iterdir()] == ["adrc.json"]


def test_in_memory_it_does_the_same() -> None:
    folder = ResultFolder(None, TERMS)
    folder.keep("adrc", {}, {"value": (1,)})
    assert folder.find("adrc", {}) == {"value": [1]}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"seed": 2}, "contains a race with another seed, 1 and not 2; give another folder"),
        ({"rollouts": 400}, "with other rollouts, 300 and not 400"),
        ({"configuration": "a = 2\n"}, "another configuration; give another folder"),
        ({"constraints": ()}, r"with other constraints, \['x<=1'\] and not \[\]"),
    ],
)
def test_other_terms_are_refused(changed: dict[str, object], message: str, tmp_path: Path) -> None:
    ResultFolder(tmp_path, TERMS).keep("adrc", {}, {})
    with pytest.raises(ConfigurationError, match=message):
        ResultFolder(tmp_path, TERMS | changed)


def test_another_definition_and_what_is_no_entry_are_refused(tmp_path: Path) -> None:
    ResultFolder(tmp_path, TERMS).keep("adrc", {"space": 1, "parts": []}, {})
    with pytest.raises(ConfigurationError, match=r"adrc.json was run with another space; remove it"):
        ResultFolder(tmp_path, TERMS).find("adrc", {"space": 2, "parts": []})
    for text in ("[]", "{", '{"terms": {}}'):
        (tmp_path / "entries" / "torn.json").write_text(text)
        with pytest.raises(ConfigurationError, match=r"torn.json: is not a result of a race; remove it"):
            ResultFolder(tmp_path, TERMS)


def test_what_another_process_has_claimed_is_left_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(race, "PAUSE", 0.01)
    ours, theirs = ResultFolder(tmp_path, TERMS), ResultFolder(tmp_path, TERMS)
    entry, said = BenchmarkEntry("adrc", "", ""), list[str]()

    def tell(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        said.append(phase)
        theirs.keep("adrc", {}, {"value": 1})

    nothing = cast("Any", None)
    with theirs.claimed("adrc"):
        race._run_jobs([RaceJob("ADRC", nothing, nothing, entry)], ours, 1, tell)  # pyright: ignore[reportPrivateUsage]
    assert said == ["another process has claimed the remaining 1 searches and scores"]
    assert ours.find("adrc") == {"value": 1}
