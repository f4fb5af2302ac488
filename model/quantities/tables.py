"""Small tables: as HTML for notebooks, in the colours and fonts of the page, and as Markdown."""

from collections.abc import Iterable, Sequence
from html import escape

SUPERSCRIPTS = {"^2": "²", "^3": "³"}
"""Powers in units → superscripts."""


def readable(text: str) -> str:
    """A text with superscripts: ``e²`` for ``e^2``."""
    for power, superscript in SUPERSCRIPTS.items():
        text = text.replace(power, superscript)
    return text


def readable_unit(unit: str) -> str:
    """A unit with superscripts: ``m²`` for ``m^2``; empty for a pure number."""
    return "" if unit == "1" else readable(unit)


def relative(deviation: float, value: float) -> str:
    """A standard deviation in per cent of its value, with two significant digits; empty from 100 % on."""
    return f"{float(f'{100 * deviation / abs(value):.2g}'):g}%" if value and deviation < abs(value) else ""


def table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """An HTML table of texts; columns of numbers, given by their indices, are aligned right."""
    sides = ["right" if column in numbers else "left" for column in range(len(header))]

    def cells(tag: str, texts: Sequence[str]) -> str:
        row = (
            f'<{tag} style="text-align:{side}">{escape(text)}</{tag}>' for side, text in zip(sides, texts, strict=True)
        )
        return f"<tr>{''.join(row)}</tr>"

    body = "".join(cells("td", row) for row in rows)
    return f"<table><thead>{cells('th', header)}</thead><tbody>{body}</tbody></table>"


def section(title: str, content: str, *, is_open: bool = False) -> str:
    """A collapsible section."""
    return f"<details{' open' if is_open else ''}><summary>{escape(title)}</summary>{content}</details>"


def page(title: str, words: str, *parts: str) -> str:
    """A title in bold followed by words, and the parts below."""
    return f"<div><p><strong>{escape(title)}</strong>: {escape(words)}</p>{''.join(parts)}</div>"


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table of cells; vertical bars are escaped."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in [headings, *rows]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    cells.insert(1, ["-" * width for width in widths])
    return "\n".join(
        "| " + " | ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True)) + " |" for line in cells
    )
