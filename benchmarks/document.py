"""Tables that a command puts into a document, between two marks."""

from collections.abc import Sequence
from pathlib import Path


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
    before, found, rest = whole.partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found and found_end):
        raise ValueError(f"{file}: lacks the marks {begin} and {end}")
    file.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")


def times(ratio: float) -> str:
    """A ratio to three digits, as a reader wants it: ``48.1 ×``, ``1 420 ×``."""
    digits = float(f"{ratio:.3g}")
    return f"{digits:,.0f} ×".replace(",", " ") if digits >= 1000 else f"{ratio:.3g} ×"


def duration(seconds: float) -> str:
    """A time in s or ms, as a reader wants it."""
    return f"{seconds:.2f} s" if seconds >= 1 else f"{seconds * 1e3:.3g} ms"
