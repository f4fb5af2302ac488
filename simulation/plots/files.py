"""Figures as files: PNG, SVG and PDF, the same bytes for the same figure."""

from io import BytesIO
from os import PathLike
from pathlib import Path

from matplotlib.figure import Figure

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.plots.style import house_style

RESOLUTION = 200
"""Dots per inch of a PNG."""

METADATA = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
"""Suffix → what to keep out of the file: anything that changes from day to day or machine to machine."""


def encode(figure: Figure, suffix: str) -> bytes:
    """A figure as the content of a file.

    Args:
        figure: what to write.
        suffix: ``.png`` (200 dots per inch), ``.svg`` or ``.pdf``.

    Raises:
        ConfigurationError: another suffix.
    """
    form = suffix.lower()
    if form not in METADATA:
        raise ConfigurationError(f"unknown suffix {suffix!r}; must be one of {', '.join(METADATA)}")
    stream = BytesIO()
    with house_style():
        figure.savefig(stream, format=form.removeprefix("."), dpi=RESOLUTION, metadata=METADATA[form])
    return stream.getvalue()


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Write a figure to a file, which appears whole or not at all.

    Args:
        figure: what to write.
        path: its suffix chooses the format: png, svg, pdf.

    Raises:
        ConfigurationError: another suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    content = encode(figure, path.suffix)
    with atomic(path) as unfinished:
        unfinished.write_bytes(content)
