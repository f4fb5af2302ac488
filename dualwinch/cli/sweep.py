"""Options of ``dualwinch sweep``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import (
    AssignmentsInBrief,
    Case,
    Config,
    Estimator,
    Figure,
    Law,
    Plugins,
    use_parts,
    with_estimator,
)

app = App(
    name="sweep",
    help_epilogue="""Examples:

    dualwinch sweep controller.observer.l0=1:20:1 --case 4
    dualwinch sweep controller.observer.l0=0.5:50:20:log --case 4 --metric mse --metric chatter --plot l0.png
    dualwinch sweep controller.kind=nftsm,adrc,pid-cascade simulation.delay_samples=0:4:1 --case 4 --out sweep.csv
    dualwinch sweep plant.vehicle.mass=8e3:1.2e4:500 controller.coordination.preload=1000:4000:250 --plot mass.svg
    dualwinch sweep reference.kind=profile,uniform --json
""",
)


@app.default
def sweep(
    *over: Annotated[
        str, Parameter(help="One or two keys: key=value,value or key=first:last:step or key=first:last:count:log.")
    ],
    case: Case = None,
    config: Config = None,
    controller: Law = None,
    estimator: Estimator = None,
    set_: AssignmentsInBrief = None,
    plugin: Plugins = None,
    metric: Annotated[
        list[str] | None,
        Parameter(help="Figure of merit to show (default mse); may be repeated.", negative=""),
    ] = None,
    out: Annotated[
        Path | None,
        Parameter(help="File for the data, a row per run with all figures of merit: .csv, .parquet, .npz."),
    ] = None,
    plot: Figure = None,
    json: Annotated[
        bool, Parameter(help="Print JSON with all figures of merit instead of a table.", negative="")
    ] = False,
) -> None:
    """Run one experiment over values of one or two keys, side by side on all cores.

    Any key of `dualwinch config` can be varied, including those that choose parts or shape the compiled code. The
    figure is a line over one key, a heat map over two.
    """
    from dualwinch.commands.sweep import run_sweep
    from dualwinch.config.experiment_file import experiment_from

    use_parts(plugin)
    base = experiment_from(case, config, controller, with_estimator(estimator, set_))
    run_sweep(base, over, metric or ["mse"], out=out, plot=plot, json=json)
