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
        Literal["fando-nftsm", "nftsm"] | None, Parameter(help="Position law the theorem is about.")
    ] = None,
    set_: Assignments = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for the report: .json.")] = None,
    plot: Annotated[Path | None, Parameter(help="File for a figure of V(t) and dV/dt: .png, .svg or .pdf.")] = None,
) -> None:
    """Hold the paper's stability theorem against given gains and a scenario.

    Prints every condition with both its sides and a verdict, over how much of the run the theorem's Lyapunov
    function decreases, nearby gains that would satisfy the conditions (or why there are none), and what the proof
    takes for granted.
    """
    from dualwinch.commands.certify import certify as run

    use_parts(plugin)
    run(case, config, controller, set_ or [], out, plot)
