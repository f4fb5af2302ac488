"""Words of tables, as Markdown shows them."""

from dualwinch.model.quantities.tables import readable_unit


def cell(text: str) -> str:
    """A text for a cell of a table."""
    return text.replace("|", "\\|")


def code(text: object) -> str:
    """A word as code."""
    return f"`{text}`"


def unit(name: str) -> str:
    """A unit as it is written by hand; nothing for a pure number or a word."""
    return readable_unit(name) if name and name != "1" else ""


def table(headings: list[str], rows: list[list[str]]) -> str:
    """A table of cells; a bar in a cell is escaped."""
    lines = [f"| {' | '.join(headings)} |", "|" + "---|" * len(headings)]
    return "\n".join([*lines, *(f"| {' | '.join(map(cell, row))} |" for row in rows)])
