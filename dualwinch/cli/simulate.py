"""``dualwinch simulate``: one run, its figures of merit, its data and its figure."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter
from rich import box
from rich.table import Table

from dualwinch.cli.doctor import versions
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
from dualwinch.cli.output import FIGURE_SUFFIXES, check_file, measured, styled, terminal, write_figure, wrote
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    from dualwinch.simulation.ensembles.result import EnsembleResult
    from dualwinch.simulation.experiment import EngineName, Experiment
    from dualwinch.simulation.results.result import Result

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
            help="In place of `simulation.engine`: compiled C, C as CasADi's code generator writes it, or CasADi's "
            "interpreter (slow; by itself only where there is no compiler)."
        ),
    ] = None,
) -> None:
    """Simulate one experiment and print its figures of merit.

    Without --case or --config the defaults of every key are used (the paper's Case 2).

    With --ensemble, many scenarios are drawn and run on all cores. --case or --config supply the values missing from
    the ensemble's file; --controller and --set change its nominal values, and relative distributions follow. The data
    hold one row per scenario, the figure is a fan chart.
    """
    from dualwinch.config.experiment_file import experiment_from
    from dualwinch.model.errors import ConfigurationError

    use_parts(plugin)
    assignments = with_estimator(estimator, set_)
    if ensemble is not None:
        _check_alone("--ensemble", stride=stride != 1, animate=animate)
        if engine is not None:
            assignments = [*assignments, f"simulation.engine={engine}"]
        simulate_ensemble(ensemble_of(ensemble, case, config, controller, assignments), scenarios, seed, out, plot)
        return
    if scenarios is not None:
        raise ConfigurationError("--scenarios: needs --ensemble")
    if seed is not None:
        raise ConfigurationError("--seed: needs --ensemble; the seed of one run is --set simulation.seed=N")
    simulate_one(experiment_from(case, config, controller, assignments), stride, engine, out, plot, animate)


def _check_alone(option: str, **others: object) -> None:
    """Raise `ConfigurationError` where an option is given beside one that it does not go with."""
    from dualwinch.model.errors import ConfigurationError

    for word, given in others.items():
        if given:
            raise ConfigurationError(f"--{word} and {option}: give one of them")


def simulate_one(
    asked: Experiment, stride: int, engine: EngineName | None, out: Path | None, plot: Path | None, animate: Path | None
) -> None:
    """Run, print, write. Everything that can be wrong with the files is found before the run."""
    from dualwinch.config.folders import check_folder
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.results.file_formats import format_of
    from dualwinch.simulation.results.storage import save
    from dualwinch.simulation.simulate import simulate as run

    if stride < 1:
        raise ConfigurationError(f"--stride = {stride}: must be a whole number >= 1")
    if out:
        format_of(out)
        check_folder(out.parent)
    check_file(plot, *FIGURE_SUFFIXES)
    if animate:
        from dualwinch.simulation.animation.animation import check_animation

        check_animation(animate)
        check_folder(animate.parent)
    engine = engine or engine_here(asked.simulation.engine)
    console = terminal(stderr=True)
    with ProgressLine("simulating") as progress:
        result = run(asked, stride=stride, engine=engine, progress=progress)
    print_result(result)
    if out:
        notes = {f"version_{name}": version for name, version in versions().items()}
        with console.status(f"writing {out}"):
            save(result, out, notes)
        wrote(out)
    if plot:
        with console.status(f"drawing {plot}"):
            from dualwinch.simulation.plots import overview

            write_figure(plot, overview(result))
    if animate:
        with console.status(f"drawing {animate}"):
            from dualwinch.simulation.animation import save_animation

            save_animation(result, animate)
        wrote(animate)


def print_result(result: Result) -> None:
    """Print outcome and figures of merit of a run."""
    from dualwinch.simulation.loop.structure import is_automatic, solver_of

    console = terminal()
    kind = result.experiment.controller.law.kind
    solver = f" ({solver_of(result.experiment)})" if is_automatic(result.experiment) else ""
    console.print(styled("bold", kind, f": {result.outcome} at {result.end_time:g} s{solver}"))
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_column()
    table.add_column(style="dim")
    for name, quantity in result.metrics.quantities.items():
        unit = "" if quantity.unit == "1" else quantity.unit.replace("^2", "²")
        table.add_row(name, measured(result.metrics[name], ".6g"), unit, quantity.meaning)
    console.print(table)


NO_COMPILER = (
    "no C compiler found, so CasADi's interpreter runs instead: the same results, tens of times slower; "
    "install gcc or clang, or add the compiler from PyPI: uv run --extra zig dualwinch …"
)


def engine_here(asked: EngineName) -> EngineName:
    """The engine asked for; the interpreter in place of ``compiled`` without a compiler, as standard error says then.

    Raises:
        CompilerNotFoundError: the compiler asked for by name (``DUALWINCH_CC``, ``CC``) is none.
    """
    from dualwinch.codegen.compiler import find_compiler
    from dualwinch.codegen.errors import CompilerNotFoundError

    if asked != "compiled":
        return asked
    try:
        find_compiler()
    except CompilerNotFoundError:
        if os.environ.get("DUALWINCH_CC") or os.environ.get("CC"):
            raise
        terminal(stderr=True, soft_wrap=True).print(NO_COMPILER)
        return "interpreter"
    return "compiled"


SCENARIOS, SEED = 100, 0
"""How many scenarios are drawn, and from which seed, where nothing else is asked for."""


def ensemble_of(
    name: str, case: int | None, config: Path | None, controller: str | None, assignments: list[str]
) -> Ensemble:
    """The ensemble a command line asks for.

    The case or file gives the values the ensemble's file does not; controller and assignments are set on its nominal
    values, and distributions relative to those follow.

    Raises:
        ConfigurationError: anything wrong with the ensemble, a key or a value.
    """
    from dualwinch.config.ensemble_file import load_ensemble, reset
    from dualwinch.config.experiment_file import experiment_from
    from dualwinch.config.toml_text import parse_assignment

    drawn = load_ensemble(name, experiment_from(case, config, None, []))
    values = dict(map(parse_assignment, assignments))
    if controller is not None:
        values = {"controller.kind": controller, **values}
    return reset(drawn, values)


def simulate_ensemble(
    asked: Ensemble, scenarios: int | None, seed: int | None, out: Path | None, plot: Path | None
) -> None:
    """Run, print, write. Everything that can be wrong with the files is found before the run."""
    from dualwinch.config.ensemble_file import ensemble_to_toml
    from dualwinch.config.folders import check_folder
    from dualwinch.simulation.ensembles.result import ensemble_writer, save_ensemble
    from dualwinch.simulation.ensembles.run import run_ensemble

    count, seed = SCENARIOS if scenarios is None else scenarios, SEED if seed is None else seed
    if out:
        ensemble_writer(out)
        check_folder(out.parent)
    check_file(plot, *FIGURE_SUFFIXES)
    with ProgressLine(f"simulating {count} scenarios") as progress:
        result = run_ensemble(asked, count, seed, traces=plot is not None, progress=progress)
    print_ensemble(result)
    if out:
        notes = {"configuration": ensemble_to_toml(asked), **{f"version_{k}": v for k, v in versions().items()}}
        save_ensemble(result, out, notes)
        wrote(out)
    if plot:
        from dualwinch.simulation.plots import fan_chart

        write_figure(plot, fan_chart(result))
    if result.partial:
        raise KeyboardInterrupt


def print_ensemble(result: EnsembleResult) -> None:
    """Print outcomes and statistics of an ensemble."""
    from dualwinch.model.quantities.tables import readable_unit
    from dualwinch.simulation.metrics.metrics import metric_quantities

    console = terminal()
    kind = result.ensemble.experiment.controller.law.kind
    counts = ", ".join(f"{count} {outcome}" for outcome, count in result.outcome_counts.items())
    console.print(styled("bold", kind, f" in '{result.ensemble.name}', seed {result.seed}: {counts}"))
    if result.partial:
        console.print(f"interrupted: {len(result)} of {result.asked} scenarios were finished and are kept")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for heading in ("mean", "median", "95 %", "worst"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("")
    statistics = result.statistics
    for name, quantity in metric_quantities(result.ensemble.experiment.metrics).items():
        unit = readable_unit(quantity.unit)
        table.add_row(name, *(measured(value) for value in statistics[name].values()), unit)
    console.print(table)
    if len(result.outcome_counts) > 1 or "completed" not in result.outcome_counts:
        console.print("Statistics are those of the completed scenarios.")
