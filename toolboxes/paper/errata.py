"""Where the paper is wrong or silent, and what dualwinch does instead; shown in docs/errata.md and in the report."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class Note:
    """One entry of the table.

    Attributes:
        id: E1 to E11 for errata, A1 to A15 for assumptions; code and configuration refer to it.
        kind: ``erratum`` (the paper prints something wrong) or ``assumption`` (it leaves something open).
        subject: in a few words.
        paper: text or gap of the paper, with its section.
        here: solution in dualwinch.
        keys: configuration keys, or tables of keys, of that solution.
        modules: source files of that solution.
        effect: in numbers, where it matters.
        page: page of the documents with these numbers.
    """

    id: str
    kind: Literal["erratum", "assumption"]
    subject: str
    paper: str
    here: str
    keys: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()
    effect: str = ""
    page: str = ""


def _notes() -> tuple[Note, ...]:
    """The entries of ``errata.toml``."""
    entries = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return tuple(
        Note(name, "erratum" if name.startswith("E") else "assumption", **{**entry, **_lists(entry)})
        for name, entry in entries.items()
    )


def _lists(entry: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    return {name: tuple(entry[name]) for name in ("keys", "modules") if name in entry}


NOTES = _notes()
"""Every entry, errata first."""

INTRODUCTION = """\
The paper is Wu et al., "Motion Control of a Flexible-Towed Underwater Vehicle Based on Dual-Winch Differential
Tension Coordination Control", J. Mar. Sci. Eng. 2025, 13(6), 1120, doi:10.3390/jmse13061120; sections are in
parentheses. An erratum (E) cannot be meant as printed; an assumption (A) supplies what the paper leaves open.
"""


def places(note: Note) -> tuple[str, ...]:
    """Configuration keys and source files of a note, in that order."""
    return note.keys + note.modules
