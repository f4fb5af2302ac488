"""Options of ``dualwinch simulate``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from dualwinch.cli.options import (
    WHOLE,
    Assignments,
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
    name="simulate",
    help_epilogue="""Examples:

    dualwinch simulate --case 4
    dualwinch simulate --case 4 --controller pid-cascade --plot pid.png
    dualwinch simulate --case 4 --animate machine.svg
    dualwinch simulate --plugin my_law.py --controller my-law --set controller.my_law.k=5
    dualwinch simulate --set plant.vehicle.mass=1.1e4 --set disturbance.vortex=true --out heavy.parquet
    dualwinch simulate --case 2 --set disturbance.force.file=gust.csv --set disturbance.force.unit=kN
    dualwinch simulate --set reference.kind=way-points --set reference.points=[20,5,40] --set reference.jerk_limit=0.2
    dualwinch simulate --ensemble sea --scenarios 100 --seed 7 --out sea.csv --plot sea.png
""",
)


@app.default
def simulate(
    *,
    case: Case = None,
    config: Config = None,
    controller: Law = None,
    estimator: Estimator = None,
    set_: Assignments = None,
    plugin: Plugins = None,
    ensemble: Annotated[
        str | None,
        Parameter(help="Run an ensemble of scenarios: `sea`, `rig`, or a TOML file (see `config --ensemble`)."),
    ] = None,
    scenarios: Annotated[int | None, WHOLE, Parameter(help="Scenarios of the ensemble (default 100).")] = None,
    seed: Annotated[int | None, WHOLE, Parameter(help="Seed of the ensemble's draws (default 0).")] = None,
    out: Annotated[
        Path | None,
        Parameter(help="File for the data: .csv, .parquet, .npz, .mat (one run) or .json (ensemble)."),
    ] = None,
    plot: Figure = None,
    animate: Annotated[Path | None, Parameter(help="File for an animation of the machine: .svg.")] = None,
    stride: Annotated[int, WHOLE, Parameter(help="Keep every n-th sample in the data.")] = 1,
    engine: Annotated[
        Literal["compiled", "casadi", "interpreter"] | None,
        Parameter(
            help="Compiled C, C as CasADi's code generator writes it, or CasADi's interpreter (slow; the default only "
            "where there is no compiler)."
        ),
    ] = None,
) -> None:
    """Simulate one experiment and print its figures of merit.

    Without --case or --config the defaults of every key are used (the paper's Case 2).

    With --ensemble, many scenarios are drawn and run on all cores. --case or --config supply the values missing from
    the ensemble's file; --controller and --set change its nominal values, and relative distributions follow. The data
    hold one row per scenario, the figure is a fan chart.
    """
    from dualwinch.model.errors import ConfigurationError

    use_parts(plugin)
    assignments = with_estimator(estimator, set_)
    if ensemble is not None:
        for word, given in (
            ("--stride", stride != 1),
            ("--engine", engine not in {None, "compiled"}),
            ("--animate", animate),
        ):
            if given:
                raise ConfigurationError(f"{word} and --ensemble: give one of them")
        from dualwinch.commands.simulate import ensemble as drawn
        from dualwinch.commands.simulate import simulate_ensemble

        simulate_ensemble(drawn(ensemble, case, config, controller, assignments), scenarios, seed, out, plot)
        return
    if scenarios is not None:
        raise ConfigurationError("--scenarios: needs --ensemble")
    if seed is not None:
        raise ConfigurationError("--seed: needs --ensemble; the seed of one run is --set simulation.seed=N")
    from dualwinch.commands.simulate import simulate as run

    run(
        case=case,
        config=config,
        controller=controller,
        assignments=assignments,
        out=out,
        plot=plot,
        animate=animate,
        stride=stride,
        engine=engine,
    )
