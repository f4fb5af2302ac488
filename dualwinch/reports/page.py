"""HTML pages from the templates of this folder, with texts escaped and pictures embedded."""

from base64 import b64encode
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from dualwinch.codegen.files import write_whole
from dualwinch.simulation.plots.page import encode

TEMPLATES = Path(__file__).parent / "templates"
"""Folder of the style that pages share, and of the kernel's pages."""


@cache
def template(name: str, folder: Path = TEMPLATES) -> Template:
    """Load a template of a folder, which may include those of `TEMPLATES`; a missing variable is an error."""
    environment = Environment(
        loader=FileSystemLoader([folder, TEMPLATES]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def write_page(path: Path, name: str, folder: Path = TEMPLATES, **content: Any) -> None:
    """Write a report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        name: of the template.
        folder: of the template.
        content: variables of the template.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, template(name, folder).render(**content), errors="xmlcharrefreplace")


def write_section(report: Path, name: str, content: str) -> bool:
    """Write a section into a report that has a place for it: ``<!-- name: begin -->`` and ``<!-- name: end -->``.

    Args:
        report: the file; a missing one, or one without the section, is left alone.
        name: of the section.
        content: HTML that replaces the present content.

    Returns:
        Whether the report has the section.

    Raises:
        OSError: the report cannot be written.
    """
    if not report.is_file():
        return False
    before, begin, remainder = report.read_text(encoding="utf-8").partition(f"<!-- {name}: begin -->")
    _, end, after = remainder.partition(f"<!-- {name}: end -->")
    if not (begin and end):
        return False
    write_whole(report, f"{before}{begin}\n{content}{end}{after}")
    return True


def sentence(words: str) -> str:
    """Words as a sentence with a capital letter, except for the name of a statistic, and a full stop."""
    beginning = words.partition(" ")[0]
    capital = beginning if "." in beginning else beginning[:1].upper() + beginning[1:]
    return f"{capital}{words[len(beginning) :]}." if words else ""


def data_uri(content: bytes | Figure) -> str:
    """A PNG or SVG, or a figure as PNG, as a data URI."""
    data = encode(content, ".png") if isinstance(content, Figure) else content
    kind = "image/png" if data.startswith(b"\x89PNG") else "image/svg+xml"
    return f"data:{kind};base64,{b64encode(data).decode()}"


def number_text(value: float) -> Markup:
    """A number for a table: three digits, with a power of ten if it is very small or very large."""
    if not np.isfinite(value):
        return Markup("–")
    if value == 0:
        return Markup("0")
    mantissa, exponent = f"{value:.2e}".split("e")
    if 1e-2 <= abs(value) < 1e5:
        rounded = float(f"{mantissa}e{exponent}")
        return escape(f"{rounded:.{max(0, 2 - int(exponent))}f}".replace("-", "−"))
    power = str(int(exponent)).replace("-", "−")
    return Markup("{}·10<sup>{}</sup>").format(mantissa.replace("-", "−"), power)
