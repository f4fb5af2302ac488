"""``dualwinch simulate``: one run, its figures of merit, its data and its figure."""

import os
from pathlib import Path

from rich import box
from rich.table import Table

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.commands.doctor import versions
from dualwinch.commands.output import check_folder, check_plot, measured, styled, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.config.ensemble_file import ensemble_to_toml, load_ensemble, reset
from dualwinch.config.experiment_file import experiment_from
from dualwinch.config.toml_text import parse_assignment
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import EnsembleResult, ensemble_writer, save_ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.loop.engine import EngineName
from dualwinch.simulation.loop.structure import is_automatic, solver_of
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.results.file_formats import format_of
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.results.storage import save
from dualwinch.simulation.simulate import simulate as run


def simulate(
    case: int | None,
    config: Path | None,
    controller: str | None,
    assignments: list[str],
    out: Path | None,
    plot: Path | None,
    animate: Path | None,
    stride: int,
    engine: EngineName | None,
) -> None:
    """Run, print, write. Everything that can be wrong with the files is found before the run."""
    asked = experiment_from(case, config, controller, assignments)
    if stride < 1:
        raise ConfigurationError(f"--stride = {stride}: must be a whole number >= 1")
    if out:
        format_of(out)
        check_folder(out.parent)
    check_plot(plot)
    if animate:
        from dualwinch.simulation.animation.animation import check_animation

        check_animation(animate)
        check_folder(animate.parent)
    engine = engine or engine_here()
    console = terminal(stderr=True)
    with ProgressLine("simulating") as progress:
        result = run(asked, stride=stride, engine=engine, progress=progress)
    print_result(result)
    if out:
        notes = {f"version_{name}": version for name, version in versions().items()}
        with console.status(f"writing {out}"):
            save(result, out, notes)
        console.print(f"wrote {out}")
    if plot:
        with console.status(f"drawing {plot}"):
            from dualwinch.simulation.plots import overview
            from dualwinch.simulation.plots import save as save_figure

            save_figure(overview(result), plot)
        console.print(f"wrote {plot}")
    if animate:
        with console.status(f"drawing {animate}"):
            from dualwinch.simulation.animation import save_animation

            save_animation(result, animate)
        console.print(f"wrote {animate}")


def print_result(result: Result) -> None:
    """Print outcome and figures of merit of a run."""
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


def engine_here() -> EngineName:
    """The fastest engine that this machine has; where that is the interpreter, a line on standard error says so.

    Raises:
        CompilerNotFoundError: the compiler asked for by name (``DUALWINCH_CC``, ``CC``) is none.
    """
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


def ensemble(
    name: str, case: int | None, config: Path | None, controller: str | None, assignments: list[str]
) -> Ensemble:
    """The ensemble a command line asks for.

    The case or file gives the values the ensemble's file does not; controller and assignments are set on its nominal
    values, and distributions relative to those follow.

    Raises:
        ConfigurationError: anything wrong with the ensemble, a key or a value.
    """
    drawn = load_ensemble(name, experiment_from(case, config, None, []))
    values = dict(map(parse_assignment, assignments))
    if controller is not None:
        values = {"controller.kind": controller, **values}
    return reset(drawn, values)


def simulate_ensemble(
    asked: Ensemble, scenarios: int | None, seed: int | None, out: Path | None, plot: Path | None
) -> None:
    """Run, print, write. Everything that can be wrong with the files is found before the run."""
    count, seed = SCENARIOS if scenarios is None else scenarios, SEED if seed is None else seed
    if out:
        ensemble_writer(out)
        check_folder(out.parent)
    check_plot(plot)
    console = terminal(stderr=True)
    with ProgressLine(f"simulating {count} scenarios") as progress:
        result = run_ensemble(asked, count, seed, traces=plot is not None, progress=progress)
    print_ensemble(result)
    if out:
        notes = {"configuration": ensemble_to_toml(asked), **{f"version_{k}": v for k, v in versions().items()}}
        save_ensemble(result, out, notes)
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import fan_chart
        from dualwinch.simulation.plots import save as save_figure

        save_figure(fan_chart(result), plot)
        console.print(f"wrote {plot}")
    if result.partial:
        raise KeyboardInterrupt


def print_ensemble(result: EnsembleResult) -> None:
    """Print outcomes and statistics of an ensemble."""
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
