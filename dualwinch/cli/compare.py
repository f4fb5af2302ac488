"""``dualwinch compare``: files of gains in the same scenarios, with paired statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dualwinch.cli.options import (
    WHOLE,
    CheckpointingWorkerOptions,
    ExperimentOptions,
    Figure,
    note_other_ensemble,
    note_other_machine,
    use_parts,
)
from dualwinch.cli.output import (
    FigureColumn,
    FigureTable,
    check_file,
    measured,
    terminal,
    version_notes,
    write_figure,
    write_json,
)
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller
    from dualwinch.simulation.ensembles.comparison import Comparison, Interval


def compare(
    *files: str,
    ensemble: str = "sea",
    scenarios: Annotated[int, WHOLE] = 200,
    seed: Annotated[int, WHOLE] = 0,
    given: ExperimentOptions = ExperimentOptions(),
    out: Path | None = None,
    plot: Figure = None,
    where: CheckpointingWorkerOptions = CheckpointingWorkerOptions(),
) -> None:
    """Compare files of gains in the same scenarios, with confidence intervals on the ratios to the first.

    A file is an experiment as `dualwinch config` prints one, or a part of it. Its [controller] tables are compared:
    position law, gains, estimator, coordination and preload; missing keys keep their defaults. Plant, sea and sensors
    come from the ensemble alone; --case or --config supply the values missing from its file. The paper's gains run with
    the nominal model and the damping of drums of the first file, and with its tension limits and preload if the limits
    are not the paper's.

    Args:
        files: TOML files of gains; `paper` means the paper's gains.
        ensemble: Ensemble of scenarios: `sea`, `rig`, `site`, or a TOML file.
        scenarios: Scenarios, the same for every file.
        seed: Seed of the draws and of the intervals.
        out: File for the statistics: .json.

    Examples:
        dualwinch compare paper best.toml
        dualwinch compare paper mine.toml --plugin my_law.py
        dualwinch compare paper best.toml calm.toml --scenarios 500 --seed 1 --out gains.json --plot gains.png
    """
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.ensembles.comparison import compare as run

    for key in given.values:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: the controller comes from the files of gains; set it there")
    use_parts(given.plugin)
    contenders, population = controllers(files), given.ensemble(ensemble)
    for name in files:
        if name != PAPER:
            note_other_ensemble(Path(name), population.name)
            if Path(name) != given.config:
                note_other_machine(Path(name), ensemble, population)
    check_file(out, ".json")
    with ProgressLine("simulating", command="compare", patient=True) as progress, where.workers(progress) as workers:
        result = run(contenders, population, scenarios, seed, workers=workers, progress=progress)
        progress(0.0, "finding infeasible scenarios")
        result.find_least_errors(progress)
        facts = to_record(result)
    print_comparison(result)
    write_json(out, facts)
    write_figure(plot, "comparison", result)
    if result.partial:
        raise where.interrupt


PAPER = "paper"
"""Name that stands for the paper's gains instead of a file."""

METHOD = "percentile bootstrap, scenarios resampled in pairs"
"""Method of the confidence intervals, in words."""


def controllers(names: Sequence[str]) -> dict[str, Controller]:
    """The controllers of files of gains, by the names given on the command line.

    The paper's gains are adapted to the machine of the first file (`paper_controller`).

    Raises:
        ConfigurationError: no file, the same file twice, or anything wrong with a file.
    """
    from dualwinch.config.experiment_file import load
    from dualwinch.controllers.paper_controller import paper_controller
    from dualwinch.model.errors import ConfigurationError

    if not names:
        raise ConfigurationError(f"give at least one file of gains, or '{PAPER}' for the paper's")
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise ConfigurationError(f"{twice}: given twice")
    controllers_by_name = {name: load(Path(name)).controller for name in names if name != PAPER}
    paper = paper_controller(next(iter(controllers_by_name.values()), None))
    return {name: paper if name == PAPER else controllers_by_name[name] for name in names}


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Full name → name in tables: the file's without folders, or the folder's if all files have the same name.

    All names stay whole if two would become equal.
    """
    paths = [Path(name) for name in names if name != PAPER]
    same_name = len({path.name for path in paths}) == 1 < len(paths)
    labels = {
        name: name if name == PAPER else str(Path(name).parent) if same_name else Path(name).name for name in names
    }
    return labels if len(set(labels.values())) == len(labels) else {name: name for name in names}


def statistics_table(result: Comparison, shown: Mapping[str, str] | None = None) -> FigureTable:
    """Statistics, scenarios with slack and outcomes, a row per file, whose name in the table may be another one."""
    from dualwinch.simulation.ensembles.result import SUMMARY
    from dualwinch.simulation.metrics.metrics import metric_quantities

    merits = metric_quantities(result.ensemble.experiment.metrics)
    statistics = SUMMARY | {f"mean_{name}": f"mean.{name}" for name in result.first.own}
    words = {"p95": "95 %"}
    columns = [FigureColumn("name", "")]
    for name, statistic in statistics.items():
        kind, _, metric = statistic.partition(".")
        merit = merits[metric]
        columns.append(FigureColumn.of_metric(name, merit, f"{merit.label}, {words.get(kind, kind)}", ".4g"))
        if name == "mean_mse":
            heading = f"{merit.label}, feasible scenarios"
            columns.append(FigureColumn.of_metric("mean_mse_within_authority", merit, heading, ".4g"))
    columns.append(FigureColumn("slack_scenarios", heading="scenarios with slack"))
    outcomes = dict.fromkeys(word for contender in result.contenders.values() for word in contender.outcome_counts)
    columns += [FigureColumn(word, heading=word.replace("_", " ")) for word in outcomes]
    rows = []
    for name, contender in result.contenders.items():
        values = {
            "name": (shown or {}).get(name, name),
            "mean_mse_within_authority": result.mean_mse_within_authority(name),
        }
        values |= contender.summary() | dict.fromkeys(outcomes, 0) | contender.outcome_counts
        rows.append([values[column.name] for column in columns])
    return FigureTable("statistics", columns, rows)


def to_record(result: Comparison) -> dict[str, Any]:
    """The comparison as plain data."""
    from dualwinch.config.ensemble_file import ensemble_to_toml
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.simulation.ensembles.comparison import CONFIDENCE, RESAMPLES

    first, bounds = next(iter(result.contenders)), result.least_errors
    least, foreseeing = bounds.means
    files = [
        {
            "name": name,
            **contender.summary(),
            "mean_mse_within_authority": result.mean_mse_within_authority(name),
            "over_first": {} if name == first else {key: asdict(pair) for key, pair in result.paired(name).items()},
            "controller": {key: value for key, value in leaves(contender.controller).items() if value is not None},
        }
        for name, contender in result.contenders.items()
    ]
    return {
        "ensemble": result.ensemble.name,
        "seed": result.seed,
        "scenarios": len(result),
        "scenarios_asked": result.asked,
        "intervals": {"method": METHOD, "confidence": CONFIDENCE, "resamples": RESAMPLES, "seed": result.seed},
        "beyond_authority": {
            "scenarios": bounds.infeasible,
            "without_bound": bounds.unknown,
            "lower_bound_mean_mse": least,
            "lower_bound_mean_mse_with_foresight": foreseeing,
        },
        "units": statistics_table(result).record()["units"] | {"lower_bound_mean_mse": "m^2", "over_first": "1"},
        "files": files,
        "configuration": ensemble_to_toml(result.ensemble),
        **version_notes(),
    }


def print_comparison(result: Comparison) -> None:
    """Print statistics and ratios."""
    from dualwinch.controllers.paper_controller import adapted
    from dualwinch.simulation.batch.authority import infeasible_words
    from dualwinch.simulation.ensembles.comparison import CONFIDENCE

    console = terminal()
    console.print(f"{len(result)} scenarios of '{result.ensemble.name}', seed {result.seed}, the same for all")
    if result.partial:
        console.print(f"interrupted: {len(result)} of {result.asked} scenarios were finished by all and are kept")
    labels = short_names(list(result.contenders))
    if PAPER in labels and (own := adapted(result.contenders[PAPER].controller)):
        first_file = next(words for name, words in labels.items() if name != PAPER)
        console.print(f"{PAPER}: the paper's gains, with the {own} of {first_file}")
    console.print(statistics_table(result, labels).render_down())
    bounds = result.least_errors
    if bounds.infeasible:
        least, foreseeing = (measured(1e6 * value, ".3g") for value in bounds.means)
        console.print(
            f"{infeasible_words(bounds.infeasible)}. Lower bound on the mean MSE of all: {least} mm² for a "
            f"non-anticipating optimal controller, {foreseeing} mm² with full foresight.",
            soft_wrap=True,
        )
    if bounds.unknown:
        console.print(bounds.unknown_words, soft_wrap=True)
    if any(set(contender.outcome_counts) != {"completed"} for contender in result.contenders.values()):
        console.print("Statistics are those of the completed scenarios, ratios those of scenarios completed by both.")
    first, *others = result.contenders
    if not others:
        return
    console.print(f"Means over those of {first}, with {100 * CONFIDENCE:g} % intervals:")
    pairs = {name: result.paired(name) for name in others}
    columns, rows = [FigureColumn("name", "")], [[labels[name]] for name in others]
    for metric in pairs[others[0]]:
        columns.append(FigureColumn(metric, heading=metric.replace("_", " ")))
        columns.append(FigureColumn("better", heading="  smaller in", factor=100, shown_unit="%"))
        for row, found in zip(rows, pairs.values(), strict=True):
            row += [_interval(found[metric].ratio_of_means), found[metric].better]
    console.print(FigureTable("ratios", columns, rows).render_down())


def _interval(interval: Interval) -> str:
    estimate, low, high = (measured(value, ".3g") for value in asdict(interval).values())
    return "–" if estimate == "–" else f"{estimate} ({low}–{high})"
