"""Options of ``dualwinch preload``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from dualwinch.cli.options import Assignments, Case, Config, Figure, Law, Plugins, use_parts

app = App(
    name="preload",
    help_epilogue="""Examples:

    dualwinch preload --case 4 --plot preload.png
    dualwinch preload --case 4 --set controller.scheduled_preload.margin=150 --out preload.json
    dualwinch preload --config tuned/best.toml --least energy
    dualwinch preload --case 4 --set reference.jerk_limit=0.1 --torque-rate 30 --error 0.002
""",
)


@app.default
def preload(
    *,
    case: Case = None,
    config: Config = None,
    controller: Law = None,
    set_: Assignments = None,
    least: Annotated[
        Literal["load", "peak", "energy"],
        Parameter(help="What to minimise: continuous load, largest tension, or work of the motors."),
    ] = "load",
    error: Annotated[float, Parameter(help="Optimum: largest distance from the reference in m that is allowed.")] = 0.0,
    torque_rate: Annotated[
        float | None, Parameter(help="Optimum: largest rate of each motor torque in N m/s (default: any).")
    ] = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for all numbers: .json.")] = None,
    plot: Figure = None,
) -> None:
    """Compare a scheduled preload with constant ones and with the least possible.

    Runs the experiment with its preload kept constant, with the best constant preload of the same error and no smaller
    tensions, with the preload scheduled, and solves for the tensions over time that load the motors least. Prints for
    each of them load, tensions, work and error.
    """
    from dualwinch.commands.preload import preload as run

    use_parts(plugin)
    run(case, config, controller, set_ or [], least, error, torque_rate, out, plot)
