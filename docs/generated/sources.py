"""Pages that stand elsewhere in the repository: notebooks, and the documents at its top."""

import re
from pathlib import Path, PurePosixPath

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
DOCUMENTS = {"CONTRIBUTING.md": "project/contributing.md", "CHANGELOG.md": "project/changelog.md"}
"""Document of the repository → page of the site."""


def _pages() -> dict[Path, str]:
    """File of the repository → page of the site, below docs/."""
    notebooks = {path: f"lessons/{path.name}" for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    return notebooks | {ROOT / name: page for name, page in DOCUMENTS.items()}


def copy_sources(app: Sphinx) -> None:
    """Make pages of these files; unchanged ones are left alone, so that notebooks keep their outputs."""
    folder = Path(app.srcdir)
    for path, page in _pages().items():
        copied = folder / page
        copied.parent.mkdir(exist_ok=True)
        if not copied.exists() or copied.read_bytes() != path.read_bytes():
            copied.write_bytes(path.read_bytes())


LINK = re.compile(r"\]\((?!\w+:|#)([^)#\s]+)")


def redirect_links(app: Sphinx, name: str, source: list[str]) -> None:
    """Links to these files lead to their pages, and those to the README to the site's first page."""
    _ = app
    known = _pages() | {ROOT / "README.md": "index.md"}
    came_from = {page: path.parent for path, page in _pages().items()}
    here = ROOT / "docs" / PurePosixPath(name).parent
    copied = next((parent for page, parent in came_from.items() if page.rpartition(".")[0] == name), here)

    def leads(match: re.Match[str]) -> str:
        wanted = (copied / match[1]).resolve()
        page = ROOT / "docs" / known[wanted] if wanted in known else wanted
        return f"]({_relative(page, here)}" if page.exists() or wanted in known else match[0]

    source[0] = LINK.sub(leads, source[0])


def _relative(page: Path, folder: Path) -> str:
    """The way from a folder to a page."""
    common = page
    ups = 0
    base = folder
    while base not in common.parents:
        base, ups = base.parent, ups + 1
    return "../" * ups + page.relative_to(base).as_posix()
