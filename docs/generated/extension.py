"""Sphinx extension: pages and parts of pages that are made of the program while the site is built.

Each directive is a function that gives Markdown; the page around it says which command prints the same.
"""

from collections.abc import Callable
from typing import Any, ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from docs.generated.columns import columns_markdown
from docs.generated.commands import commands_markdown
from docs.generated.keys import keys_markdown
from docs.generated.lab_page import link_to_lab, write_lab
from docs.generated.mathematics import displayed, inline
from docs.generated.metrics import metrics_markdown
from docs.generated.public import public_markdown
from docs.generated.sources import copy_sources, redirect_links


class Generated(SphinxDirective):
    """A directive whose content is Markdown from a function."""

    has_content = True
    optional_arguments = 100
    make: ClassVar[Callable[[str], str]]

    def run(self) -> list[nodes.Node]:
        """The Markdown as nodes; its headings become sections of the page."""
        text = type(self).make(" ".join(self.arguments))
        around = nodes.Element()
        self.state.nested_parse(StringList(text.splitlines(), self.env.docname), 0, around, match_titles=True)
        return around.children


DIRECTIVES = {
    "columns": lambda _: columns_markdown(),
    "commands": lambda _: commands_markdown(),
    "keys": lambda _: keys_markdown(),
    "metrics": lambda _: metrics_markdown(),
    "public": public_markdown,
}
"""Name → Markdown from the directive's arguments."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register directives and what is done before pages are read."""
    for name, make in DIRECTIVES.items():
        app.add_directive(f"dualwinch-{name}", type(name.title(), (Generated,), {"make": staticmethod(make)}))
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    app.connect("builder-inited", copy_sources)
    app.connect("source-read", redirect_links)
    app.connect("source-read", link_to_lab)
    app.connect("build-finished", write_lab)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
