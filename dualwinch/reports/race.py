"""The report of ``dualwinch race``: one HTML file with table, figures, the rule, and what each search had."""

from collections.abc import Mapping
from pathlib import Path

from dualwinch.codegen.files import atomic
from dualwinch.reports.page import template
from dualwinch.reports.reproduction import data_uri
from dualwinch.simulation.plots.page import encode
from dualwinch.tuning.benchmark.comparison import RULE
from dualwinch.tuning.benchmark.result import BenchmarkResult


def write_race_report(path: Path, found: BenchmarkResult, facts: Mapping[str, str]) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        found: the race.
        facts: provenance, name → value.

    Raises:
        OSError: the file cannot be written.
    """
    headings, rows = found.table()
    page = template("race.html.j2").render(
        heading=found.heading,
        rule=RULE,
        headings=headings,
        rows=rows,
        notes=found.notes(),
        picture=data_uri(encode(found.plot(), ".png")),
        fronts=data_uri(encode(found.plot_fronts(), ".png")),
        ablations=found.ablations(),
        stress=found.stress_rows(),
        searches=found.search_rows(),
        facts={"seed": str(found.terms.seed), "method": found.terms.method, **facts},
        configuration=found.terms.configuration.strip(),
    )
    with atomic(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")
