"""Options of ``dualwinch certify``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from dualwinch.cli.options import Assignments, Case, Config, Plugins, use_parts

app = App(
    name="certify",
    help_epilogue="""Examples:

    dualwinch certify --case 4
    dualwinch certify --case 3 --plot lyapunov.png --out certificate.json
    dualwinch certify --case 4 --controller nftsm --set controller.nftsm.k=2
""",
)


@app.default
def certify(
    *,
    case: Case = None,
    config: Config = None,
    controller: Annotated[
        Literal["fando-nftsm", "nftsm"] | None, Parameter(help="Position law that the theorem covers.")
    ] = None,
    set_: Assignments = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for the report: .json.")] = None,
    plot: Annotated[Path | None, Parameter(help="File for a figure of V(t) and dV/dt: .png, .svg or .pdf.")] = None,
) -> None:
    """Check the paper's stability theorem for given gains and a scenario.

    Prints every condition with both sides and a verdict, the share of the run in which the theorem's Lyapunov function
    decreases, nearby gains that satisfy the conditions (or why there are none), and what the proof assumes.
    """
    from dualwinch.commands.certify import certify as run

    use_parts(plugin)
    run(case, config, controller, set_ or [], out, plot)
