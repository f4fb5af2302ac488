"""Options of ``dualwinch reproduce``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

app = App(
    name="reproduce",
    help_epilogue="""Examples:

    dualwinch reproduce
    dualwinch reproduce --cases 4 --controllers fando-nftsm,nftsm --out case4
    dualwinch reproduce --extended
""",
)


@app.default
def reproduce(
    *,
    out: Annotated[Path, Parameter(help="Folder for figures, data, metrics and the report.")] = Path("results"),
    cases: Annotated[str, Parameter(help="Cases to run, separated by commas.")] = "1,2,3,4",
    controllers: Annotated[
        str, Parameter(help="Controllers to compare, separated by commas.")
    ] = "fando-nftsm,nftsm,pid-cascade",
    extended: Annotated[
        bool, Parameter(help="Also compare all position laws and coordinations, beyond the paper's.", negative="")
    ] = False,
) -> None:
    """Run the paper's cases and controllers, and write every figure, the data and one report.

    Prints the figures of merit and, where Case 4 runs with both sliding-mode controllers, the reductions of
    Figure 21 beside the paper's.
    """
    from dualwinch.commands.reproduce import reproduce as run

    run(out, cases.split(","), controllers.split(","), extended=extended)
