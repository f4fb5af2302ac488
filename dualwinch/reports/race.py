"""The report of ``dualwinch race``: one HTML file with table, figures, the rule, and what each search had."""

from collections.abc import Mapping
from pathlib import Path

from dualwinch.codegen.files import atomic
from dualwinch.reports.page import template
from dualwinch.reports.reproduction import data_uri
from dualwinch.simulation.plots.page import encode
from dualwinch.tuning.benchmark.comparison import RULE
from dualwinch.tuning.benchmark.result import BenchmarkResult
from dualwinch.tuning.benchmark.summary import (
    ablation_rows,
    heading,
    notes,
    race_table,
    search_rows,
    stress_rows,
)


def write_race_report(path: Path, found: BenchmarkResult, facts: Mapping[str, str]) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        found: the race.
        facts: provenance, name → value.

    Raises:
        OSError: the file cannot be written.
    """
    headings, rows = race_table(found)
    page = template("race.html.j2").render(
        heading=heading(found),
        rule=RULE,
        headings=headings,
        rows=rows,
        notes=notes(found),
        picture=data_uri(encode(found.plot(), ".png")),
        fronts=data_uri(encode(found.plot_fronts(), ".png")),
        ablations=ablation_rows(found),
        stress=stress_rows(found),
        searches=search_rows(found),
        facts={"seed": str(found.terms.seed), "method": found.terms.method, **facts},
        configuration=found.terms.configuration.strip(),
    )
    with atomic(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")
