"""Options of ``dualwinch lab``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import WHOLE

app = App(
    name="lab",
    help_epilogue="""Examples:

    dualwinch lab
    dualwinch lab --port 8000 --no-browser
    dualwinch lab --out lab.html
""",
)


@app.default
def lab(
    *,
    out: Annotated[Path | None, Parameter(help="Write the page to this file (.html) instead of serving it.")] = None,
    port: Annotated[int, WHOLE, Parameter(help="Port on this machine; 0: any that is free.")] = 0,
    browser: Annotated[bool, Parameter(help="Open the page in a browser.")] = True,
) -> None:
    """Play with the closed loop in a browser: every case, law and number, redrawn at once.

    The page is one file and needs no server; it runs what `simulate` runs, compiled to WebAssembly. The first
    call builds it, which takes about a minute and needs zig (`pip install ziglang`); it is kept for the next.
    """
    from dualwinch.commands.lab import lab as run

    run(out, port, browser=browser)
