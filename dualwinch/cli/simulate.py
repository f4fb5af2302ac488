"""The command ``simulate``: one run or an ensemble, its figures of merit, data and figure."""

from __future__ import annotations

import os
import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from dualwinch.cli.notes import other_ensemble
from dualwinch.cli.options import (
    WHOLE,
    CheckpointingWorkerOptions,
    ControllerOptions,
    Figure,
    Json,
    Whole,
    default_of,
)
from dualwinch.cli.output import (
    check_file,
    note,
    print_result,
    print_run,
    terminal,
    version_notes,
    write_figure,
    wrote,
)
from dualwinch.cli.progress import ProgressLine
from dualwinch.model.quantities.figures import FigureColumn, FigureTable, Sentence

if TYPE_CHECKING:
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    from dualwinch.simulation.ensembles.result import EnsembleResult
    from dualwinch.simulation.ensembles.streamed import EnsembleStatistics
    from dualwinch.simulation.experiment import EngineName

SCENARIOS, SEED = 100, 0
"""Defaults for an ensemble."""


def simulate(
    *,
    options: ControllerOptions = ControllerOptions(),
    ensemble: str | None = None,
    scenarios: Annotated[Whole, default_of(lambda: SCENARIOS)] = None,
    seed: Annotated[Whole, default_of(lambda: SEED)] = None,
    out: Path | None = None,
    plot: Figure = None,
    animate: Path | None = None,
    stride: Annotated[int, WHOLE] = 1,
    engine: Literal["compiled", "casadi", "interpreter"] | None = None,
    statistics_only: bool = False,
    where: CheckpointingWorkerOptions = CheckpointingWorkerOptions(),
    json: Json = False,
) -> None:
    """Simulate one experiment and print its figures of merit.

    Without --case or --config the defaults of every key are used (the paper's Case 2).

    With --ensemble, many scenarios are drawn and run on all cores. --case or --config supply the values missing from
    the ensemble's file; --controller and --set change its nominal values, and relative distributions follow. The data
    hold one row per scenario, the figure is a fan chart.

    Args:
        ensemble: Run an ensemble of scenarios: `sea`, `rig`, `site`, or a TOML file (see `config --ensemble`).
        scenarios: Scenarios of the ensemble.
        seed: Seed of the ensemble's draws.
        out: File for the data: .csv, .parquet, .npz, .mat (one run) or .json (ensemble).
        animate: File for an animation of the machine: .svg.
        stride: Keep every n-th sample in the data.
        engine: Replaces `simulation.engine`: compiled C, C written by CasADi's code generator, or CasADi's interpreter
            (slow; used by default only if there is no compiler).
        statistics_only: Keep only the ensemble's statistics, so that memory does not grow with the number of scenarios;
            median and 95 % are within 0.1 %.

    Examples:
        dualwinch simulate --case 4
        dualwinch simulate --case 4 --controller pid-cascade --plot pid.png
        dualwinch simulate --case 4 --animate machine.svg
        dualwinch simulate --plugin my_law.py --controller my-law --set controller.my_law.k=5
        dualwinch simulate --set plant.vehicle.mass=1.1e4 --set disturbance.vortex=true --out heavy.parquet
        dualwinch simulate --case 2 --set disturbance.force.file=gust.csv --set disturbance.force.unit=kN
        dualwinch simulate --set reference.kind=way-points --set reference.points=[20,5] --set reference.jerk_limit=0.2
        dualwinch simulate --ensemble sea --scenarios 100 --seed 7 --out sea.csv --plot sea.png
        dualwinch simulate --ensemble rig --scenarios 100000 --statistics-only --cluster tcp://pc:8786 --checkpoint done
    """
    from dualwinch.model.errors import ConfigurationError

    if ensemble is None:
        alone = {
            "scenarios": scenarios,
            "seed": seed,
            "cluster": None if where.cluster == os.environ.get("DUALWINCH_CLUSTER") else where.cluster,
            "checkpoint": where.checkpoint,
            "statistics-only": statistics_only or None,
        }
        for name, value in alone.items():
            if value is not None:
                hint = "; the seed of one run is --set simulation.seed=N" if name == "seed" else ""
                raise ConfigurationError(f"--{name}: needs --ensemble{hint}")
        simulate_one(options, stride, engine, out, plot, animate, replace(where, cluster=None), json=json)
        return
    for name, requested in (("stride", stride != 1), ("animate", animate)):
        if requested:
            raise ConfigurationError(f"--{name} and --ensemble: give one of them")
    if engine:
        options = replace(options, set_=[*(options.set_ or []), f"simulation.engine={engine}"])
    draws, typed = options.ensemble(ensemble), f"{options.typed} {shlex.join(['--ensemble', ensemble])}".lstrip()
    if options.config:
        note(other_ensemble(options.config, draws.name))
    count, seed = SCENARIOS if scenarios is None else scenarios, SEED if seed is None else seed
    simulate_ensemble(draws, count, seed, out, plot, where, typed, statistics_only=statistics_only, json=json)


def simulate_one(
    given: ControllerOptions,
    stride: int,
    engine: EngineName | None,
    out: Path | None,
    plot: Path | None,
    animate: Path | None,
    where: CheckpointingWorkerOptions,
    *,
    json: bool,
) -> None:
    """Check the files, then run, print and write."""
    from dualwinch.extensions import FUNCTIONS, extension
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.results.file_formats import FORMATS, save
    from dualwinch.simulation.simulate import simulate as run

    experiment = given.experiment()
    if stride < 1:
        raise ConfigurationError(f"--stride = {stride}: must be a whole number >= 1")
    if stride > 1 and not (out or plot or animate):
        raise ConfigurationError("--stride: needs --out, --plot or --animate")
    check_file(out, *FORMATS)
    check_file(animate, ".svg")
    save_animation = extension(FUNCTIONS, "save_animation", "--animate") if animate else None
    engine = engine or engine_here(experiment.simulation.engine)
    with ProgressLine("simulating", command="simulate", patient=True) as progress, where.workers(progress):
        result = run(experiment, stride=stride, engine=engine, progress=progress)
    print_result(result, given.typed, json=json)
    console = terminal(stderr=True)
    if out:
        with console.status(f"writing {out}"):
            save(result, out, version_notes())
        wrote(out)
    write_figure(plot, "overview", result)
    if animate and save_animation:
        with console.status(f"drawing {animate}"):
            save_animation(result, animate)
        wrote(animate)


def simulate_ensemble(
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    out: Path | None,
    plot: Path | None,
    where: CheckpointingWorkerOptions,
    typed: str,
    *,
    statistics_only: bool,
    json: bool,
) -> None:
    """Check the files, then run, print and write."""
    from dualwinch.config.ensemble_file import ensemble_to_toml
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.ensembles.result import SUFFIXES, save_ensemble
    from dualwinch.simulation.ensembles.run import run_ensemble
    from dualwinch.simulation.ensembles.streamed import EnsembleStatistics, ensemble_statistics

    check_file(out, *([".json"] if statistics_only else SUFFIXES))
    if statistics_only and plot:
        raise ConfigurationError("--plot and --statistics-only: give one of them")
    with (
        ProgressLine(f"simulating {scenarios} scenarios", command="simulate", patient=True) as progress,
        where.workers(progress) as workers,
    ):
        run = ensemble_statistics if statistics_only else partial(run_ensemble, traces=plot is not None)
        result = run(ensemble, scenarios, seed, workers=workers, progress=progress)
    print_ensemble(result, typed, json=json)
    if out:
        notes = {"configuration": ensemble_to_toml(ensemble), **version_notes()}
        if isinstance(result, EnsembleStatistics):
            result.save(out, notes)
        else:
            save_ensemble(result, out, notes)
        wrote(out)
    write_figure(plot, "fan_chart", result)
    if result.partial:
        raise where.interrupt


NO_COMPILER = (
    "no C compiler found, so CasADi's interpreter runs instead: the same results, tens of times slower; "
    "install gcc or clang, or add the compiler from PyPI: uv run --extra zig dualwinch …"
)


def engine_here(engine: EngineName) -> EngineName:
    """The requested engine; the interpreter instead of ``compiled`` if there is no compiler, with a message.

    Raises:
        CompilerNotFoundError: ``DUALWINCH_CC`` or ``CC`` names a compiler that is not there.
    """
    from dualwinch.codegen.compiler import find_compiler
    from dualwinch.codegen.errors import CompilerNotFoundError

    if engine != "compiled":
        return engine
    try:
        find_compiler()
    except CompilerNotFoundError:
        if os.environ.get("DUALWINCH_CC") or os.environ.get("CC"):
            raise
        terminal(stderr=True, soft_wrap=True).print(NO_COMPILER)
        return "interpreter"
    return "compiled"


def print_ensemble(result: EnsembleResult | EnsembleStatistics, typed: str, *, json: bool) -> None:
    """Print outcomes and statistics of an ensemble, and remarks, whose commands have the options `typed`."""
    from dualwinch.analysis.remarks import in_full, remarks
    from dualwinch.simulation.metrics.metrics import metric_quantities

    experiment, statistics = result.ensemble.experiment, result.statistics
    columns = [FigureColumn.of(*metric) for metric in metric_quantities(experiment.metrics).items()]
    kinds = {"mean": "mean", "median": "median", "p95": "95 %", "worst": "worst"}
    rows = [(kind, *(statistics[column.name][kind] for column in columns)) for kind in kinds]
    columns = [FigureColumn("statistic", "", words=kinds), *columns]
    completed = result.outcome_counts.get("completed", 0)
    facts = {"ensemble": result.ensemble.name, "seed": result.seed, "outcomes": result.outcome_counts}
    facts |= {"scenarios": len(result), "scenarios_asked": result.asked, "statistics": statistics}
    counts = ", ".join(f"{count} {outcome}" for outcome, count in result.outcome_counts.items())
    population = f" in '{result.ensemble.name}', seed {result.seed}: {counts}"
    figures: list[FigureTable | Sentence] = [Sentence(population, experiment.controller.law.kind)]
    if result.partial:
        figures.append(Sentence(f"interrupted: {len(result)} of {result.asked} scenarios were finished and are kept"))
    figures.append(FigureTable("statistics", columns, rows, layout="columns"))
    if completed < len(result):
        words = f"Statistics are those of the {completed} of {len(result)} scenarios that were completed."
        figures.append(Sentence(words))
    print_run(facts, figures, (in_full(words, typed) for words in remarks(result)), experiment, json=json)
