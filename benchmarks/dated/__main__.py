"""Render dated results: ``python -m benchmarks.dated --write docs/benchmarks.md`` puts each table between its marks.

A file of results names the day, the versions, the commit at which the code of its commands stands, and for each table
its command, its page (`PAGE` unless it is stated), headings and rows.
"""

import json
from pathlib import Path
from typing import Any

from benchmarks.document import command, markdown, publish

RESULTS = Path(__file__).with_name("2026-11.json")
"""The latest results."""

PAGE = "docs/benchmarks.md"
"""Page of most tables, and of the facts about the machine."""


def tables(results: dict[str, Any], page: str = PAGE) -> dict[str, str]:
    """Mark → text of its block on a page: tables, and where, when and with which versions they were measured."""
    facts = " · ".join(f"{name}: {value}" for name, value in results["machine"].items())
    blocks = {
        name: markdown(table["headings"], table["rows"])
        for name, table in results["tables"].items()
        if table.get("page", PAGE) == page
    }
    return blocks | (
        {"machine": f"*{results['date']}, code at commit `{results['commit']}` · {facts}*"} if page == PAGE else {}
    )


def main() -> None:
    """Print the tables of a page, or write them into it."""
    document = command(__doc__).parse_args().write
    page = PAGE if document is None else document.as_posix()
    publish(document, tables(json.loads(RESULTS.read_text(encoding="utf-8")), page))


if __name__ == "__main__":
    main()
