"""Small tables: as HTML for notebooks, in the colours and fonts of the page, and as Markdown."""

from collections.abc import Iterable, Sequence
from html import escape

SUPERSCRIPTS = {"^2": "²", "^3": "³"}
"""Powers as units write them, and as people read them."""


def readable(text: str) -> str:
    """A text as it is read: ``e²`` for ``e^2``."""
    for power, superscript in SUPERSCRIPTS.items():
        text = text.replace(power, superscript)
    return text


def readable_unit(unit: str) -> str:
    """A unit as it is read: ``m²`` for ``m^2``, nothing for a pure number."""
    return "" if unit == "1" else readable(unit)


def relative(deviation: float, value: float) -> str:
    """A standard deviation as a share of its value, in per cent with two significant digits; empty where it is 1."""
    return f"{float(f'{100 * deviation / abs(value):.2g}'):g}%" if value and deviation < abs(value) else ""


def table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of texts; columns of numbers, by their indices, stand to the right."""
    sides = ["right" if column in numbers else "left" for column in range(len(header))]

    def cells(tag: str, texts: Sequence[str]) -> str:
        found = (
            f'<{tag} style="text-align:{side}">{escape(text)}</{tag}>' for side, text in zip(sides, texts, strict=True)
        )
        return f"<tr>{''.join(found)}</tr>"

    body = "".join(cells("td", row) for row in rows)
    return f"<table><thead>{cells('th', header)}</thead><tbody>{body}</tbody></table>"


def section(title: str, content: str, *, is_open: bool = False) -> str:
    """Something that folds away under its title."""
    return f"<details{' open' if is_open else ''}><summary>{escape(title)}</summary>{content}</details>"


def page(title: str, words: str, *parts: str) -> str:
    """A title in bold, words behind it, and what stands below."""
    return f"<div><p><strong>{escape(title)}</strong>: {escape(words)}</p>{''.join(parts)}</div>"


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of cells; a bar in a cell is escaped."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in [headings, *rows]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    cells.insert(1, ["-" * width for width in widths])
    return "\n".join(
        "| " + " | ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True)) + " |" for line in cells
    )
