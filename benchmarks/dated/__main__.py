"""Render dated results: ``python -m benchmarks.dated --write docs/benchmarks.md`` puts each table between its marks.

A file of results names the day, the versions, the git tag at which the code of its commands stands, and for each table
its command, headings and rows.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.document import markdown, put

RESULTS = Path(__file__).with_name("2026-11.json")
"""The latest results."""


def tables(results: dict[str, Any]) -> dict[str, str]:
    """Mark → text of its block: the tables, and where, when and with which versions they were measured."""
    facts = " · ".join(f"{name}: {value}" for name, value in results["machine"].items())
    blocks = {name: markdown(table["headings"], table["rows"]) for name, table in results["tables"].items()}
    return blocks | {"machine": f"*{results['date']}, code at tag `{results['tag']}` · {facts}*"}


def main() -> None:
    """Print the tables, or write them into a document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.dated", description=__doc__)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose tables are replaced")
    document = parser.parse_args().write
    for mark, text in tables(json.loads(RESULTS.read_text(encoding="utf-8"))).items():
        print(text, end="\n\n")
        if document:
            put(document, mark, text)


if __name__ == "__main__":
    main()
