"""The lab itself, a page of the site."""

from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

PAGE = "lab-page.html"
LINK = f'<p><a href="{PAGE}"><strong>Open the lab</strong></a> (0.7 MB, runs in your browser)</p>\n\n'


def link_to_lab(app: Sphinx, name: str, source: list[str]) -> None:
    """The page on the lab begins with a link to it; code hosts, which have no such page, show none."""
    if name == "lab" and app.builder.format == "html":
        source[0] = source[0].replace("```sh\n", LINK + "```sh\n", 1)


def write_lab(app: Sphinx, error: Exception | None) -> None:
    """Build the lab beside the other pages."""
    if error or app.builder.format != "html":
        return
    from dualwinch.toolboxes.lab.cli.lab import lab

    logging.getLogger(__name__).info("building the lab")
    lab(out=Path(app.outdir) / PAGE, browser=False)
