"""Options of ``dualwinch show``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

app = App(
    name="show",
    help_epilogue="""Examples:

    dualwinch simulate --case 4 --set controller.observer.l0=20 --out run.parquet
    dualwinch show run.parquet
    dualwinch show run.parquet --out run.html --browser
""",
)


@app.default
def show(
    run: Annotated[Path, Parameter(help="A run that `simulate --out` has written: .parquet, .csv, .npz or .mat.")],
    /,
    *,
    out: Annotated[Path | None, Parameter(help="The page (.html; default: beside the run).")] = None,
    browser: Annotated[bool, Parameter(help="Open the page in a browser.")] = False,
) -> None:
    """Write the lab's page with a run of your own in it, as run A to compare with."""
    from dualwinch.commands.lab import show as write

    write(run, out, browser=browser)
