"""Numbers of the documents: written by a command, or set by a page's own code, the configuration or a named source.

A number of a page may stand

1. in a block between two marks, which a command of ``benchmarks/`` writes;
2. elsewhere, where such a block of the same page has it, or of a page that its paragraph links to;
3. where code on the page has it;
4. where it is a default, a bound or a value of the paper's cases and the built-in ensembles;
5. in a phrase of ``docs/given.toml``, which names its source: the paper, a standard, a derivation, a library.

Whole numbers up to 20 are free. Links, code and mathematics are not looked at.
"""

import ast
import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import dualwinch as dw
from benchmarks.quoted.__main__ import BLOCKS
from docs.generated.keys import keys_markdown
from dualwinch.config.ensemble_file import ensemble_to_toml

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "project" not in page.relative_to(ROOT).parts]

FREE = 20
"""The largest whole number that needs no source."""

NUMBER = re.compile(r"(?<![\w.#=\-])(\d{1,3}(?: \d{3})+|\d+)(\.\d+)?(e-?\d+)?(?![\w/]|\.\d)")
IN_CODE = re.compile(r"(\d+)(\.\d+)?(e[+-]?\d+)?")
BLOCK = re.compile(r"<!-- ([\w ]+): begin -->(.*?)<!-- \1: end -->", re.DOTALL)
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
UNREAD = re.compile(r"<!--.*?-->|`[^`]*`|\]\([^)]*\)|\$\$.*?\$\$|\$[^$\n]+\$|<https?:[^>]*>", re.DOTALL)
PAGE_LINK = re.compile(r"\]\(([\w./-]+\.md)[^)]*\)")


def values(text: str, pattern: re.Pattern[str] = NUMBER) -> set[float]:
    """Every number of a text."""
    return {float(match.group().replace(" ", "")) for match in pattern.finditer(text)}


@cache
def written(page: Path) -> set[float]:
    """Numbers that commands have written into a page."""
    return values("\n".join(text for _, text in BLOCK.findall(page.read_text(encoding="utf-8"))))


@cache
def configured() -> set[float]:
    """Defaults and bounds of every key, and the values of cases and ensembles."""
    files = [dw.to_toml(dw.case(number)) for number in (1, 2, 3, 4)]
    files += [ensemble_to_toml(dw.load_ensemble(name)) for name in ("sea", "rig")]
    files += [file.read_text(encoding="utf-8") for file in (ROOT / "simulation/ensembles").glob("*.toml")]
    found = values("\n".join([keys_markdown(), *files]), IN_CODE)
    return found | {100 * value for value in found}


@cache
def given() -> dict[str, dict[str, str]]:
    """Page → phrase → source; those of ``"*"`` are allowed in every page."""
    return tomllib.loads((ROOT / "docs" / "given.toml").read_text(encoding="utf-8"))


def places(phrase: str, text: str) -> Iterator[tuple[int, int]]:
    """Where a phrase stands in a page, however its lines are broken."""
    pattern = r"\s+".join(map(re.escape, phrase.split()))
    return (match.span() for match in re.finditer(pattern, text))


def blanked(pattern: re.Pattern[str], text: str) -> str:
    """A text with spaces in place of what a pattern matches."""
    return pattern.sub(lambda match: re.sub(r"[^\n]", " ", match.group()), text)


def untraced(text: str, phrases: dict[str, str], linked: Path | None = None) -> list[str]:
    """Numbers of a page that have no source, each with what stands around it.

    Args:
        text: the page.
        phrases: those of ``docs/given.toml`` that it may have.
        linked: its folder, where links to other pages begin; None: no link is followed.
    """
    prose = blanked(UNREAD, blanked(FENCE, blanked(BLOCK, text)))
    code = "\n".join([*FENCE.findall(text), *re.findall(r"`[^`]+`", FENCE.sub("", text))])
    known = values("\n".join(block for _, block in BLOCK.findall(text))) | values(code, IN_CODE) | configured()
    allowed = [place for phrase in phrases for place in places(phrase, text)]
    found = []
    for match in NUMBER.finditer(prose):
        value = float(match.group().replace(" ", ""))
        free = match.group().isdigit() and value <= FREE
        if free or value in known or any(start <= match.start() < end for start, end in allowed):
            continue
        begin, end = text.rfind("\n\n", 0, match.start()), text.find("\n\n", match.end())
        links = PAGE_LINK.findall(text[max(begin, 0) : end if end > 0 else len(text)]) if linked else []
        pages = [page for link in links if linked and (page := (linked / link).resolve()).exists()]
        if not any(value in written(page) for page in pages):
            found.append(" ".join(text[max(0, match.start() - 60) : match.end() + 30].split()))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_number_has_a_source(page: Path) -> None:
    name = page.relative_to(ROOT).as_posix()
    found = untraced(page.read_text(encoding="utf-8"), given().get("*", {}) | given().get(name, {}), page.parent)
    assert not found, (
        f"{name}: {len(found)} numbers that no command wrote. Let a command write them (benchmarks/quoted), or give "
        "their source in docs/given.toml if they rest on no run:\n  … " + "\n  … ".join(found)
    )


def test_a_made_up_number_is_found() -> None:
    assert untraced("The error is 3.87 mm.", {}) == ["The error is 3.87 mm."]
    assert untraced("The error is 3.87 mm.\n\n<!-- a: begin -->\n| 3.87 |\n<!-- a: end -->\n", {}) == []
    assert untraced("The error is 3.87 mm, of `--error 3.87`.", {}) == []
    assert untraced("The error is\n3.87 mm, and not 3.86 mm.", {"The error is 3.87 mm": "the paper"}) != []
    assert untraced("The error is\n3.87 mm, and 3.86 [mm](3.85).", {"The error is 3.87 mm, and 3.86": "x"}) == []
    assert untraced("12 runs of 50 s", {}) == []  # few, and the length of the track and of a run


def test_what_is_given_stands_in_its_page() -> None:
    texts = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
    texts["*"] = "\n".join(texts.values())
    gone = [
        (page, phrase) for page, phrases in given().items() for phrase in phrases if not [*places(phrase, texts[page])]
    ]
    assert gone == []


@cache
def marks_of(source: Path) -> list[str]:
    """Patterns of the texts in a file of Python; a formatted part stands for anything."""
    found = []
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(re.escape(node.value))
        elif isinstance(node, ast.JoinedStr):
            parts = [re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".+" for part in node.values]
            found.append("".join(parts))
    return [pattern for pattern in found if pattern.strip(".+")]


def writes(command: str, mark: str) -> bool:
    """Whether the sources of a command, or the dated results that it renders, name a mark."""
    place = ROOT / command.replace(".", "/")
    sources = sorted(place.glob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    if any(mark in json.loads(file.read_text(encoding="utf-8"))["tables"] for file in place.glob("*.json")):
        return True
    return any(re.fullmatch(pattern, mark) for file in sources if file.exists() for pattern in marks_of(file))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_each_page_names_the_command_that_writes_its_blocks(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    commands = set(re.findall(r"benchmarks(?:\.\w+)+", text)) | ({"benchmarks"} if "-m benchmarks " in text else set())
    unwritten = [mark for mark, _ in BLOCK.findall(text) if not any(writes(command, mark) for command in commands)]
    assert unwritten == [], f"{page.name}: names no command that writes these blocks"
    assert all(block.strip() for _, block in BLOCK.findall(text)), f"{page.name}: a block is empty"


def test_the_marks_of_every_quoted_block_stand_in_its_page() -> None:
    marks = {
        (page.relative_to(ROOT).as_posix(), mark)
        for page in PAGES
        for mark, _ in BLOCK.findall(page.read_text("utf-8"))
    }
    assert {(block.page, block.mark) for block in BLOCKS} <= marks
