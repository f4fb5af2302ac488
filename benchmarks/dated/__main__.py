"""Render dated results: ``python -m benchmarks.dated --write docs/benchmarks.md`` puts each table between its marks.

A file of results names the day, the versions, the commit at which the code of its commands stands, and for each table
its command, headings and rows.
"""

import json
from pathlib import Path
from typing import Any

from benchmarks.document import command, markdown, publish

RESULTS = Path(__file__).with_name("2026-11.json")
"""The latest results."""


def tables(results: dict[str, Any]) -> dict[str, str]:
    """Mark → text of its block: the tables, and where, when and with which versions they were measured."""
    facts = " · ".join(f"{name}: {value}" for name, value in results["machine"].items())
    blocks = {name: markdown(table["headings"], table["rows"]) for name, table in results["tables"].items()}
    return blocks | {"machine": f"*{results['date']}, code at commit `{results['commit']}` · {facts}*"}


def main() -> None:
    """Print the tables, or write them into a document."""
    publish(command(__doc__).parse_args().write, tables(json.loads(RESULTS.read_text(encoding="utf-8"))))


if __name__ == "__main__":
    main()
