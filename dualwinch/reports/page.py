"""HTML pages from the templates of this folder, with texts escaped and pictures embedded."""

from base64 import b64encode
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from dualwinch.codegen.files import write_whole
from dualwinch.simulation.plots.page import encode


@cache
def template(name: str) -> Template:
    """Load a template of `dualwinch/reports/templates`; a variable that it is not given is an error."""
    environment = Environment(
        loader=PackageLoader("dualwinch.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def write_page(path: Path, name: str, **content: Any) -> None:
    """Write a report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        name: of the template.
        content: variables of the template.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, template(name).render(**content), errors="xmlcharrefreplace")


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
