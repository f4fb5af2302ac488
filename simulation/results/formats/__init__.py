"""Formats of result files: each knows how to write a `Content` to a path and how to read it back."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.results.content import Content
from dualwinch.simulation.results.formats import csv_file, matlab_file, numpy_file, parquet_file


@dataclass(frozen=True)
class Format:
    """A format of files.

    Attributes:
        write: writes a content to a path; the file appears whole or not at all.
        read: the content of a path; facts that are no text may come as the text of their JSON.
    """

    write: Callable[[Content, Path], None]
    read: Callable[[Path], Content]


FORMATS = {
    ".csv": Format(csv_file.write, csv_file.read),
    ".parquet": Format(parquet_file.write, parquet_file.read),
    ".npz": Format(numpy_file.write, numpy_file.read),
    ".mat": Format(matlab_file.write, matlab_file.read),
}
"""Suffix → format."""


def format_of(path: Path) -> Format:
    """The format of a path's suffix.

    Raises:
        ConfigurationError: unknown suffix.
    """
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise ConfigurationError(
            f"{path.name}: unknown suffix {path.suffix!r}; must be one of {', '.join(FORMATS)}"
        ) from None
