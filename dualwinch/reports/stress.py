"""The section of a study's report that says what breaks first."""

from pathlib import Path

from dualwinch.codegen.files import atomic
from dualwinch.reports.page import template
from dualwinch.reports.reproduction import data_uri
from dualwinch.simulation.plots.page import encode
from dualwinch.tuning.robustness.result import RobustnessResult

BEGIN, END = "<!-- stress: begin -->", "<!-- stress: end -->"
"""Where the section stands in a report; it is empty in a new one."""


def show_stress(report: Path, found: RobustnessResult) -> bool:
    """Put what was found into a report of `dualwinch tune`, in the place of what stands there.

    Args:
        report: the file; nothing happens where there is none, or one of something else.
        found: what it is to show.

    Returns:
        Whether the report shows it.

    Raises:
        OSError: the report cannot be written.
    """
    if not report.is_file():
        return False
    before, begin, rest = report.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        return False
    with atomic(report) as unfinished:
        unfinished.write_text(f"{before}{BEGIN}\n{section(found)}{END}{after}", encoding="utf-8")
    return True


def section(found: RobustnessResult) -> str:
    """The section as HTML."""
    headings, rows = found.table()
    return template("stress.html.j2").render(
        heading=found.heading,
        headings=headings,
        rows=rows,
        notes=found.notes(),
        picture=data_uri(encode(found.plot(), ".png")),
    )
