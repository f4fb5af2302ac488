"""Tables that a command prints and puts into a document, between two marks."""

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from pathlib import Path


def command(about: str | None) -> ArgumentParser:
    """A command line with ``--write FILE``, described by a module's docstring."""
    parser = ArgumentParser(description=about, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose tables are replaced")
    return parser


def publish(file: Path | None, texts: Mapping[str, str]) -> None:
    """Print texts, mark → text, and put each between its marks in a file, if one is named."""
    for mark, text in texts.items():
        print(text, end="\n\n")
        if file:
            put(file, mark, text)


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table, its first column to the left."""
    lines = [f"| {' | '.join(headings)} |", "|---|" + "--:|" * (len(headings) - 1)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def put(file: Path, mark: str, text: str) -> None:
    """Replace what stands between ``<!-- mark: begin -->`` and ``<!-- mark: end -->``.

    Raises:
        ValueError: the file lacks one of the marks.
    """
    begin, end = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    whole = file.read_text(encoding="utf-8")
    before, begin_mark, remainder = whole.partition(begin)
    _, end_mark, after = remainder.partition(end)
    if not (begin_mark and end_mark):
        raise ValueError(f"{file}: lacks the marks {begin} and {end}")
    file.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")


def times(ratio: float) -> str:
    """A ratio to three digits, as a reader wants it: ``48.1 ×``, ``1 420 ×``."""
    digits = float(f"{ratio:.3g}")
    return f"{digits:,.0f} ×".replace(",", " ") if digits >= 1000 else f"{ratio:.3g} ×"
