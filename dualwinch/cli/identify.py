"""Options of ``dualwinch identify``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import WHOLE, AssignmentsInBrief, Case, Config, Figure, Plugins, Priors, use_parts

app = App(
    name="identify",
    help_epilogue="""Examples:

    dualwinch simulate --case 4 --set simulation.readings=true --out run.parquet    # a log, for want of one
    dualwinch identify run.parquet --fit plant.vehicle.mass,plant.vehicle.drag_coefficient --case 4
    dualwinch identify run.parquet --fit "plant.rope_*.modulus" --hold-out 20% --plot fit.png --out fitted.toml
    dualwinch identify a.csv b.csv --ensemble rig --fit plant.vehicle.mass --column F1=load_cell_left:kN
    dualwinch identify run.mat --fit plant.vehicle.mass,sensors.load_cell_zero_* --prior plant.vehicle.mass=1e4+-500
    dualwinch identify run.parquet --fit plant.vehicle.mass --disturbance force.parquet
    dualwinch simulate --set disturbance.force.file=force.parquet    # the sea of that log, again
    dualwinch tune --ensemble fitted-ensemble.toml --time 60s    # gains for the machines that the logs allow for
""",
)


@app.default
def identify(
    logs: Annotated[list[Path], Parameter(help="Logs of one machine: .csv, .parquet, .mat or .npz.", negative="")],
    *,
    fit: Annotated[
        list[str],
        Parameter(help="Keys to fit, separated by commas; * stands for anything; may be repeated.", negative=""),
    ],
    case: Case = None,
    config: Config = None,
    ensemble: Annotated[
        str | None,
        Parameter(
            help="Ensemble, such as `rig`: what it draws that a log can tell is fitted as well, its draws being known "
            "beforehand."
        ),
    ] = None,
    set_: AssignmentsInBrief = None,
    prior: Priors = None,
    column: Annotated[
        list[str] | None,
        Parameter(help="Where a reading is found, F1=load_cell_left:kN; may be repeated.", negative=""),
    ] = None,
    hold_out: Annotated[str, Parameter(help="Share of each log, its end, that is not fitted but predicted.")] = "0%",
    starts: Annotated[int, WHOLE, Parameter(help="Searches from different starts, which tell distinct optima.")] = 1,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of these starts, and of the ensemble's draws.")] = 0,
    profile: Annotated[
        list[str] | None,
        Parameter(help="Keys whose likelihood is followed away from the best; may be repeated.", negative=""),
    ] = None,
    disturbance: Annotated[
        Path | None,
        Parameter(help="File for what acted on the vehicle, .csv or .parquet; disturbance.force.file takes it."),
    ] = None,
    unrecorded: Annotated[
        str,
        Parameter(
            help="Torque that nobody recorded, over the recorded one, from which on a log is refused as one of another "
            "machine."
        ),
    ] = "10%",
    plugin: Plugins = None,
    out: Annotated[
        Path | None,
        Parameter(help="File for the machine, .toml; beside it go NAME-ensemble.toml and NAME.json."),
    ] = None,
    plot: Figure = None,
) -> None:
    """Find out what some numbers of a machine are from what its sensors said.

    The torques of a log drive the plant, an extended Kalman filter predicts all readings one sample ahead, and the
    numbers are those with which it is surprised least. Prints estimates with deviations, what the logs cannot tell, and
    whether what is left is noise.
    """
    from dualwinch.commands.identify import run_identify

    use_parts(plugin)
    run_identify(
        logs,
        fit,
        case,
        config,
        set_ or [],
        ensemble=ensemble,
        priors=prior or [],
        columns=column or [],
        hold_out=hold_out,
        starts=starts,
        seed=seed,
        profiles=profile or [],
        disturbance=disturbance,
        unrecorded=unrecorded,
        out=out,
        plot=plot,
    )
