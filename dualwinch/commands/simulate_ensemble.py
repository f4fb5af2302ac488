"""``dualwinch simulate --ensemble``: many scenarios, their statistics, one row each in a file, and a fan chart."""

from pathlib import Path

from rich import box
from rich.table import Table

from dualwinch.commands.doctor import versions
from dualwinch.commands.folders import check_folder
from dualwinch.commands.output import measured, styled, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.commands.simulate import check_plot, experiment
from dualwinch.config.ensemble_file import ensemble_to_toml, load_ensemble, reset
from dualwinch.config.toml_text import parse_assignment
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.result import EnsembleResult, ensemble_writer, save_ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.metrics.metrics import metric_quantities

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
    drawn = load_ensemble(name, experiment(case, config, None, []))
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
