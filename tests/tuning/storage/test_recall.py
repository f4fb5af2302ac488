"""A study rests on the parts it was begun with: they are found again, and never others in their place."""

import hashlib
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from dualwinch.cli import main
from dualwinch.config.plugins import load_plugin
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.tuning.storage.parts import PartRecord, StudyName, in_words, part_record, part_records, recall
from tests.own_parts import DriftFree, StateFeedback
from tests.spring_law import SPRING, changed

WORDS = ["tune", "--case", "4", "--set", "simulation.duration=0.05", "--set", "controller.kind=spring"]
SEA = StudyName("sea")
SEARCH = ["--space", "controller.spring.stiffness", "--constraint", "none", "--trials"]


def forgotten() -> None:
    """As in another process: the law is registered and imported no more."""
    law = POSITION_LAWS._parts.pop("spring")
    sys.modules.pop(law.__module__)


def noted_spring(folder: Path) -> PartRecord:
    """What a study notes of the law."""
    file = folder / "law.py"
    file.write_text(SPRING)
    load_plugin(str(file))
    parts = part_records(override(case(4), {"controller.kind": "spring"}))
    forgotten()
    return parts[0]


def test_a_study_notes_the_parts_that_are_not_built_in(tmp_path: Path) -> None:
    part = noted_spring(tmp_path)
    assert part == {
        "what": "position law",
        "kind": "spring",
        "source": str(tmp_path / "law.py"),
        "script": False,
        "sha256": hashlib.sha256(SPRING.encode()).hexdigest(),
    }
    assert in_words([part]) == f"position law 'spring' of law.py, sha256 {part['sha256']}"
    assert part_records(case(4)) == []
    own = override(case(4, law=StateFeedback()), {})
    assert [(part["kind"], part["source"]) for part in part_records(own, [DriftFree()], {"a": DriftFree()})] == [
        ("drift-free", "tests.own_parts"),
        ("state-feedback", "tests.own_parts"),
    ]


def test_parts_are_found_again_where_they_were(tmp_path: Path) -> None:
    part = noted_spring(tmp_path)
    recall(SEA, [part])
    assert part_record(POSITION_LAWS["spring"]) == part
    recall(SEA, [part])
    assert "state-feedback" not in POSITION_LAWS
    recall(SEA, [part_record(StateFeedback)])
    assert POSITION_LAWS["state-feedback"] is StateFeedback


def test_parts_may_have_moved(tmp_path: Path) -> None:
    part = noted_spring(tmp_path)
    moved = (tmp_path / "law.py").rename(tmp_path / "moved.py")
    with pytest.raises(ConfigurationError) as caught:
        recall(SEA, [part])
    assert str(caught.value) == (
        f"--study sea: needs the position law 'spring' of {tmp_path}/law.py: plugin {tmp_path}/law.py: cannot be read "
        "(No such file or directory); give the file that defines it, --plugin FILE"
    )
    load_plugin(str(moved))
    recall(SEA, [part])


def test_parts_that_have_changed_are_refused(tmp_path: Path) -> None:
    part = noted_spring(tmp_path)
    for text, reason in (
        (changed(("self.damping * e2", "2 * self.damping * e2")), "was begun with another position law 'spring'"),
        (changed(('"spring"', '"string"')), "it is no longer defined there; give the file that defines it"),
        ("x = 1\n", "defines no part"),
    ):
        (tmp_path / "law.py").write_text(text)
        with pytest.raises(ConfigurationError, match=reason):
            recall(SEA, [part])
        POSITION_LAWS._parts.pop("spring", None)
    (tmp_path / "law.py").write_text(SPRING + "# another comment\n")
    with pytest.raises(ConfigurationError) as caught:
        recall(SEA, [part])
    assert (
        f"has sha256 {hashlib.sha256((SPRING + '# another comment' + chr(10)).encode()).hexdigest()[:12]}, had "
        in str(caught.value)
    )
    assert part["sha256"][:12] in str(caught.value)


def test_a_part_of_a_built_in_kind_is_not_taken_for_the_built_in_one() -> None:
    @dataclass(frozen=True)
    class Nftsm(StateFeedback):
        kind: ClassVar = "nftsm"

    part = part_records(case(4, law=Nftsm()))[0]
    with pytest.raises(
        ConfigurationError, match=r"^--study sea: was begun with another position law 'nftsm': the source"
    ):
        recall(SEA, [part])


def test_a_part_of_a_script_is_asked_for(tmp_path: Path) -> None:
    part = noted_spring(tmp_path) | {"script": True}
    with pytest.raises(ConfigurationError, match=r"law\.py: that is a script, which is not run again for it; give"):
        recall(SEA, [part])  # pyright: ignore[reportArgumentType]


def test_a_file_that_changes_after_it_was_imported_is_noted_as_it_was(tmp_path: Path) -> None:
    part = noted_spring(tmp_path)
    load_plugin(part["source"])
    Path(part["source"]).write_text("x = 1\n")
    assert part_record(POSITION_LAWS["spring"]) == part


def test_a_part_without_a_source_cannot_be_noted() -> None:
    namespace: dict[str, object] = {"__name__": "nowhere"}
    exec("from tests.own_parts import StateFeedback\nclass Typed(StateFeedback):\n    kind = 'typed'\n", namespace)  # noqa: S102
    typed = namespace["Typed"]
    with pytest.raises(ConfigurationError, match=r"^nowhere\.Typed: has no source to identify it by; define"):
        part_record(typed)  # pyright: ignore[reportArgumentType]


def tuned(folder: Path, *words: str) -> str:
    """Tune as on the command line; the error where there is one."""
    try:
        main([*WORDS, *SEARCH, *words, "--out", str(folder / "out")])
    except SystemExit:
        return "failed"
    return ""


@pytest.mark.slow
def test_a_study_says_which_parts_it_rests_on_and_goes_on_with_no_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, digest = tmp_path / "law.py", hashlib.sha256(SPRING.encode()).hexdigest()
    file.write_text(SPRING)
    assert not tuned(tmp_path, "4", "--plugin", str(file))
    told = f"position law 'spring' of law.py, sha256 {digest}"
    assert f"# parts: {told}\n" in (tmp_path / "out" / "best.toml").read_text()
    assert json.loads((tmp_path / "out" / "study.json").read_text())["parts"] == told
    assert digest in (tmp_path / "out" / "report.html").read_text()

    forgotten()
    capsys.readouterr()
    assert not tuned(tmp_path, "6", "--resume")
    assert (
        f"next: dualwinch simulate --config {tmp_path / 'out' / 'best.toml'} --plugin {file}\n"
        in capsys.readouterr().err
    )
    assert len(json.loads((tmp_path / "out" / "study.json").read_text())["trials"]["number"]) == 6

    file.write_text(changed(("self.damping * e2", "2 * self.damping * e2")))
    capsys.readouterr()
    forgotten()
    for words in (("--resume",), ("--resume", "--plugin", str(file)), ("--plugin", str(file))):
        assert tuned(tmp_path, "8", *words)
        error = capsys.readouterr().err.splitlines()[-1]
        begin = f"dualwinch: error: {tmp_path / 'out' / 'study.journal'}: study 'tuning' was begun with another "
        assert error.startswith(f"{begin}position law 'spring': the ")
        assert error.endswith(f", had {digest[:12]}; restore it, or give another --out or --study")
