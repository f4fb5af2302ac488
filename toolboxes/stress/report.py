"""Robustness margins as a section of the report of ``dualwinch tune``."""

from pathlib import Path

from dualwinch.toolbox import report_page
from dualwinch.toolboxes.stress.result import StressResult


def show_stress(report: Path, result: StressResult) -> bool:
    """Write robustness margins into a report of ``dualwinch tune``, in place of the section's present content.

    Args:
        report: the file; a missing one, or one without the section, is left alone.
        result: the robustness margins.

    Returns:
        Whether the report shows them.

    Raises:
        OSError: the report cannot be written.
    """
    headings, rows = result.table()
    section = report_page.template("stress.html.j2", Path(__file__).parent / "templates").render(
        heading=result.heading,
        headings=headings,
        rows=rows,
        notes=result.notes(),
        picture=report_page.data_uri(result.plot()),
    )
    return report_page.write_section(report, "stress", section)
