"""Options of ``dualwinch sensitivities``."""

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
    name="sensitivities",
    help_epilogue="""Examples:

    dualwinch sensitivities "plant.vehicle.*" --case 4
    dualwinch sensitivities plant.vehicle.mass controller.observer.l0 --case 4 --metric mse --metric peak_tension
    dualwinch sensitivities "plant.rope_*.modulus" nominal.vehicle.mass --column F1 --column tau_1 --plot slopes.png
    dualwinch sensitivities "sensors.load_cell_*" --set simulation.readings=true --column F1_read --out slopes.csv
    dualwinch sensitivities "plant.winch_*.radius_error" sensors.position_bias --case 4 --json
""",
)


@app.default
def sensitivities(
    *keys: Annotated[
        str, Parameter(help="Keys of continuous numbers, also separated by commas; * stands for anything.")
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
    column: Annotated[
        list[str] | None,
        Parameter(help="Column of the result, over the time (default e); may be repeated.", negative=""),
    ] = None,
    out: Annotated[
        Path | None,
        Parameter(help="File for the columns and their derivatives: .csv, .parquet, .npz."),
    ] = None,
    plot: Figure = None,
    json: Annotated[bool, Parameter(help="Print JSON instead of tables.", negative="")] = False,
) -> None:
    """Say how a run changes with numbers of plant, sensors, disturbance and controller: exact derivatives.

    Every key of `dualwinch config` that is a continuous number of these will do, and nominal.* for what the controller
    believes of the plant: a plant.* alone leaves that as it is. Random signals are the same draws throughout, and
    sensors that read in steps are taken to read without them. Tables and figure show the changes to first order, for
    one more percent of each number.
    """
    from dualwinch.commands.sensitivities import run_sensitivities
    from dualwinch.config.experiment_file import experiment_from

    use_parts(plugin)
    base = experiment_from(case, config, controller, with_estimator(estimator, set_))
    run_sensitivities(base, keys, metric or ["mse"], column or ["e"], out=out, plot=plot, json=json)
