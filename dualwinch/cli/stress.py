"""Options of ``dualwinch stress``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import WHOLE, AssignmentsInBrief, Case, Plugins, use_parts

app = App(
    name="stress",
    help_epilogue="""Examples:

    dualwinch stress tuned/best.toml
    dualwinch stress tuned/best.toml --out tuned
    dualwinch stress best.toml --ensemble my-rig.toml --base sea --scenarios 50 --seed 1
    dualwinch stress --case 4 --ensemble sea --base none
    dualwinch stress best.toml --constraint "worst.peak_tension<=5500" --constraint "worst.mse<=1*paper"
""",
)


@app.default
def stress(
    file: Annotated[
        Path | None, Parameter(help="Gains: best.toml of `dualwinch tune`, or any experiment as TOML.")
    ] = None,
    *,
    case: Case = None,
    set_: AssignmentsInBrief = None,
    plugin: Plugins = None,
    ensemble: Annotated[str, Parameter(help="Ensemble that gives the imperfections: `rig`, or a TOML file.")] = "rig",
    base: Annotated[
        str,
        Parameter(
            help="Ensemble to which they are added: `sea`, a TOML file, or `none` for the experiment as it is.",
        ),
    ] = "sea",
    constraint: Annotated[
        list[str] | None,
        Parameter(
            help="Constraints, e.g. worst.peak_tension<=6000, mean.chatter<=0.25*paper (what the paper's gains "
            "reach in the base); may be repeated; none: only that runs are completed. Default: those of the study "
            "beside the file, no slack, no peak beyond tension_max, no more than 4 times the paper's MSE.",
            negative="",
        ),
    ] = None,
    scenarios: Annotated[int, WHOLE, Parameter(help="Scenarios, the same at every size and for all gains.")] = 20,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of the draws.")] = 0,
    out: Annotated[
        Path | None,
        Parameter(help="Folder for stress.json and stress.svg; a report of `dualwinch tune` there shows them."),
    ] = None,
) -> None:
    """Find which imperfection breaks gains first, and at which size, beside the paper's gains.

    Everything that the ensemble draws or sets and the base does not is an imperfection. Each is scaled, alone and with
    all others, from a thousandth of its size in the ensemble to a hundred times it, until the worst scenario breaks a
    constraint.
    """
    from dualwinch.commands.stress_run import run_stress

    use_parts(plugin)
    run_stress(
        file,
        case,
        set_ or [],
        ensemble=ensemble,
        base=base,
        constraints=constraint,
        scenarios=scenarios,
        seed=seed,
        out=out,
    )
