"""The HTML report of ``dualwinch race``."""

from collections.abc import Mapping
from pathlib import Path

from dualwinch.toolbox import ensemble_file, idealisations, report_page
from dualwinch.toolboxes.race.comparison import RULE
from dualwinch.toolboxes.race.result import RaceResult


def write_race_report(path: Path, result: RaceResult, facts: Mapping[str, str]) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        result: the race.
        facts: provenance, name → value.

    Raises:
        OSError: the file cannot be written.
    """
    headings, rows = result.table()
    idealised = idealisations.summary(
        idealisations.idealisations(ensemble_file.loads_ensemble(result.terms.configuration).experiment)
    )
    report_page.write_page(
        path,
        "race.html.j2",
        Path(__file__).parent / "templates",
        heading=result.heading,
        rule=RULE,
        headings=headings,
        rows=rows,
        notes=[*result.notes(), *([report_page.sentence(idealised)] if idealised else [])],
        picture=report_page.data_uri(result.plot()),
        fronts=report_page.data_uri(result.plot_fronts()),
        ablations=result.ablations(),
        stress=result.stress_rows(),
        searches=result.search_rows(),
        facts={"seed": str(result.terms.seed), "method": result.terms.method, **facts},
        configuration=result.terms.configuration.strip(),
    )
