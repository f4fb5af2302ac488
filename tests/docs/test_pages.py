"""Documents point at what exists; README and site name every page."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WRITTEN = [path for path in sorted(DOCS.rglob("*.md")) if not path.relative_to(DOCS).as_posix().startswith("project/")]
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *WRITTEN]
MADE = {"project/contributing", "project/changelog"}
"""Pages that the site makes of documents which stand elsewhere."""


def anchors(document: Path) -> set[str]:
    """Names of a page's headings, as links use them."""
    headings = re.findall(r"^#+ (.+)$", document.read_text(encoding="utf-8"), re.MULTILINE)
    plain = (re.sub(r"\]\([^)]*\)|[^\w\s-]", "", heading.lower()) for heading in headings)
    return {re.sub(r"\s", "-", heading.strip()) for heading in plain}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_figures_and_headings_exist(document: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", document.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)[^)]*\)", text)
    missing = []
    for target in targets:
        if re.match(r"\w+:", target):
            continue
        name, _, heading = target.partition("#")
        page = (document.parent / name).resolve() if name else document
        if not page.exists() or (heading and page.suffix == ".md" and heading not in anchors(page)):
            missing.append(target)
    assert missing == []


def test_the_site_lists_every_page_and_notebook_once() -> None:
    trees = re.findall(
        r"^```\{toctree\}\n(.*?)^```$", (DOCS / "index.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    lines = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    listed = [re.sub(r"^.* <(.+)>$", r"\1", line) for line in lines]
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in WRITTEN} - {"index"}
    notebooks = {f"lessons/{path.stem}" for path in (ROOT / "notebooks").glob("*.ipynb")}
    assert sorted(listed) == sorted(pages | notebooks | MADE)


def test_the_readme_leads_to_the_site_and_every_notebook() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    files = [*(ROOT / "notebooks").glob("*.ipynb"), DOCS / "index.md"]
    assert [file.name for file in files if f"({file.relative_to(ROOT)})" not in readme] == []
