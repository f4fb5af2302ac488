"""Options of ``dualwinch race``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import COORDINATIONS, ESTIMATORS, LAWS, OWN, WHOLE, AssignmentsInBrief, Plugins, use_parts

app = App(
    name="race",
    help_epilogue="""Examples:

    dualwinch race --ensemble rig --out race
    dualwinch race --ensemble sea --law fando-nftsm --law adrc --rollouts 5000
    dualwinch race --law fando-nftsm --estimator all --coordination all
    dualwinch race --ablations --searches 3 --rollouts 10000 --stress
    dualwinch race --plugin my_law.py --law my-law --law adrc
""",
)


@app.default
def race(
    *,
    ensemble: Annotated[str, Parameter(help="Ensemble of scenarios: `rig`, `sea`, or a TOML file.")] = "rig",
    law: Annotated[
        list[str] | None,
        Parameter(help=f"Position law: {LAWS}, {OWN}; may be repeated. Default: all.", negative=""),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        Parameter(
            help=f"Estimator: {ESTIMATORS}, {OWN}, or all; may be repeated. Default: the ensemble's, as of "
            "`dualwinch tune`.",
            negative="",
        ),
    ] = None,
    coordination: Annotated[
        list[str] | None,
        Parameter(
            help=f"Coordination: {COORDINATIONS}, {OWN}, or all; may be repeated. Default: the paper's.", negative=""
        ),
    ] = None,
    ablations: Annotated[
        bool, Parameter(help="Include the paper's law without each of its parts.", negative="")
    ] = False,
    plugin: Plugins = None,
    rollouts: Annotated[int, WHOLE, Parameter(help="Rollouts of each search.")] = 30_000,
    searches: Annotated[
        int,
        WHOLE,
        Parameter(help="Searches per entry, each with its own seed: several show how much is luck."),
    ] = 1,
    scenarios: Annotated[int | None, WHOLE, Parameter(help="Scenarios a candidate is tuned on (default 12).")] = None,
    held_out: Annotated[int, WHOLE, Parameter(help="Held-out scenarios for the score.")] = 200,
    set_: AssignmentsInBrief = None,
    constraint: Annotated[
        list[str] | None,
        Parameter(help="As of `dualwinch tune`, for all; may be repeated; none: no constraint.", negative=""),
    ] = None,
    method: Annotated[str | None, Parameter(help="Optimiser, as of `dualwinch tune`.")] = None,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of all scenarios and searches.")] = 0,
    stress: Annotated[
        bool, Parameter(help="Find out what breaks the best of each first (`dualwinch stress`).", negative="")
    ] = False,
    out: Annotated[Path, Parameter(help="Folder that keeps the race, to be continued.")] = Path("race"),
) -> None:
    """Tune every law with the same number of rollouts, and score all of them in the same held-out scenarios.

    Same seeds, constraints and scenarios for all; errors are compared scenario by scenario with those of the paper's
    gains, and a fixed rule decides which laws differ. Ctrl-C keeps finished entries: the same call
    continues with the rest, and a call with other laws adds them. The folder receives race.json, report.html, figures,
    and the gains of each entry as a configuration.
    """
    from dualwinch.commands.race_run import run_race

    use_parts(plugin)
    run_race(
        out,
        ensemble=ensemble,
        laws=law,
        estimators=estimator,
        coordinations=coordination,
        ablations=ablations,
        rollouts=rollouts,
        searches=searches,
        scenarios=scenarios,
        held_out=held_out,
        settings=set_ or [],
        constraints=constraint,
        method=method,
        seed=seed,
        stress=stress,
    )
