"""``dualwinch compare``: files of gains in the same scenarios, with paired statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter
from rich import box
from rich.table import Table

from dualwinch.cli.doctor import versions
from dualwinch.cli.options import WHOLE, Figure, Plugins, use_parts
from dualwinch.cli.output import FIGURE_SUFFIXES, check_file, terminal, write_figure, write_json
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller
    from dualwinch.simulation.ensembles.comparison import Comparison
    from dualwinch.simulation.ensembles.ensemble import Ensemble

app = App(
    name="compare",
    help_epilogue="""Examples:

    dualwinch compare paper best.toml
    dualwinch compare paper mine.toml --plugin my_law.py
    dualwinch compare paper best.toml calm.toml --scenarios 500 --seed 1 --out gains.json --plot gains.png
""",
)


@app.default
def compare(
    *files: Annotated[str, Parameter(help="TOML files of gains; `paper` means the paper's gains.")],
    ensemble: Annotated[str, Parameter(help="Ensemble of scenarios: `sea`, `rig`, or a TOML file.")] = "sea",
    scenarios: Annotated[int, WHOLE, Parameter(help="Scenarios, the same for every file.")] = 200,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of the draws and of the intervals.")] = 0,
    config: Annotated[
        Path | None, Parameter(help="Experiment that supplies the values missing from the ensemble's file.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        Parameter(name="--set", help="key=value of the ensemble's nominal values; may be repeated.", negative=""),
    ] = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for the statistics: .json.")] = None,
    plot: Figure = None,
) -> None:
    """Compare files of gains in the same scenarios, with confidence intervals on the ratios to the first.

    A file is an experiment as `dualwinch config` prints one, or a part of it. Its [controller] tables are compared:
    position law, gains, estimator, coordination and preload; missing keys keep their defaults. Plant, sea and sensors
    come from the ensemble alone.
    """
    from dualwinch.simulation.ensembles.comparison import compare as run

    use_parts(plugin)
    wanted, drawn = controllers(files), ensemble_of(ensemble, config, set_ or [])
    check_file(out, ".json")
    check_file(plot, *FIGURE_SUFFIXES)
    with ProgressLine("simulating") as progress:
        result = run(wanted, drawn, scenarios, seed, progress=progress)
        progress(0.0, "finding infeasible scenarios")
        facts = as_json(result)
    print_comparison(result, facts)
    if out:
        write_json(out, facts)
    if plot:
        from dualwinch.simulation.plots import comparison

        write_figure(plot, comparison(result))
    if result.partial:
        raise KeyboardInterrupt


PAPER = "paper"
"""Name that stands for the paper's gains instead of a file."""

METHOD = "percentile bootstrap, scenarios resampled in pairs"
"""How the intervals are made, in words."""

ROWS = {
    "mean_mse": ("MSE, mean", "mm²", 1e6),
    "mean_mse_within_authority": ("mean within authority", "mm²", 1e6),
    "median_mse": ("median", "mm²", 1e6),
    "p95_mse": ("95 %", "mm²", 1e6),
    "mean_chatter": ("chatter, mean", "N", 1.0),
    "max_tension": ("largest tension", "N", 1.0),
    "min_tension": ("smallest tension", "N", 1.0),
    "slack_share": ("slack, of the samples", "%", 100.0),
    "slack_scenarios": ("scenarios with slack", "", 1.0),
    "saturated_share": ("saturated, of the samples", "%", 100.0),
}
"""Statistic → name, unit and factor in the printed table."""


def controllers(names: Sequence[str]) -> dict[str, Controller]:
    """The controllers of files of gains, by the names they were asked for with.

    Raises:
        ConfigurationError: no file, one twice, or anything wrong with a file.
    """
    from dualwinch.config.experiment_file import load
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.ensembles.comparison import paper_controller

    if not names:
        raise ConfigurationError(f"give at least one file of gains, or '{PAPER}' for the paper's")
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise ConfigurationError(f"{twice}: given twice")
    return {name: paper_controller() if name == PAPER else load(Path(name)).controller for name in names}


def ensemble_of(name: str, config: str | Path | None, assignments: Sequence[str]) -> Ensemble:
    """The ensemble a command line asks for.

    Raises:
        ConfigurationError: anything wrong with the ensemble, a key or a value, or a key of the controller.
    """
    from dualwinch.config.ensemble_file import load_ensemble, reset
    from dualwinch.config.experiment_file import load
    from dualwinch.config.toml_text import parse_assignment
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.experiment import Experiment

    values = dict(map(parse_assignment, assignments))
    for key in values:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: the controller comes from the files of gains; set it there")
    return reset(load_ensemble(name, load(Path(config)) if config else Experiment()), values)


def as_json(result: Comparison) -> dict[str, Any]:
    """Everything the comparison says, JSON-ready: NaN becomes null."""
    from dualwinch.config.ensemble_file import ensemble_to_toml
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.simulation.ensembles.comparison import CONFIDENCE, RESAMPLES

    first = next(iter(result.contenders))
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
    return _finite(
        {
            "ensemble": result.ensemble.name,
            "seed": result.seed,
            "scenarios": len(result),
            "scenarios_asked": result.asked,
            "intervals": {"method": METHOD, "confidence": CONFIDENCE, "resamples": RESAMPLES, "seed": result.seed},
            "beyond_authority": {
                "scenarios": int((result.least_mse > 0).sum()),
                "least_mean_mse": float(result.least_mse.mean()),
                "least_mean_mse_foreseeing": float(result.least_mse_foreseeing.mean()),
            },
            "files": files,
            "configuration": ensemble_to_toml(result.ensemble),
            **{f"version_{name}": version for name, version in versions().items()},
        }
    )


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not abs(value) < float("inf") else value


def print_comparison(result: Comparison, facts: Mapping[str, Any]) -> None:
    """Print statistics and ratios.

    Args:
        result: the comparison.
        facts: the same as `as_json` gives it.
    """
    from dualwinch.model.quantities.tables import readable_unit
    from dualwinch.simulation.ensembles.comparison import CONFIDENCE

    console = terminal()
    ensemble = result.ensemble
    console.print(f"{len(result)} scenarios of '{ensemble.name}', seed {result.seed}, the same for all")
    if result.partial:
        console.print(f"interrupted: {len(result)} of {result.asked} scenarios were finished by all and are kept")
    files = facts["files"]
    table = _table(files)
    own = {
        f"mean_{metric.table()}": (
            f"{metric.table()}, mean".replace("_", " "),
            readable_unit(metric.quantity.unit),
            1.0,
        )
        for metric in ensemble.experiment.metrics
    }
    for key, (words, unit, factor) in (ROWS | own).items():
        table.add_row(words, *(_number(file[key], factor) for file in files), unit)
    for outcome in dict.fromkeys(outcome for file in files for outcome in file["outcomes"]):
        table.add_row(outcome.replace("_", " "), *(str(file["outcomes"].get(outcome, 0)) for file in files), "")
    console.print(table)
    if beyond := facts["beyond_authority"]["scenarios"]:
        least, foreseeing = (
            1e6 * facts["beyond_authority"][key] for key in ("least_mean_mse", "least_mean_mse_foreseeing")
        )
        console.print(
            f"{beyond} scenarios are infeasible: they need more force than the motors can "
            f"deliver. Lower bound on their mean MSE: {least:.3g} mm² for a non-anticipating optimal controller, "
            f"{foreseeing:.3g} mm² with full foresight.",
            soft_wrap=True,
        )
    if any(set(file["outcomes"]) != {"completed"} for file in files):
        console.print("Statistics are those of the completed scenarios, ratios those of scenarios completed by both.")
    if len(files) == 1:
        return
    console.print(f"Means over those of {files[0]['name']}, with {100 * CONFIDENCE:g} % intervals:")
    ratios = _table(files[1:])
    pairs = [file["over_first"] for file in files[1:]]
    for metric in pairs[0]:
        ratios.add_row(metric.replace("_", " "), *(_interval(pair[metric]["ratio_of_means"]) for pair in pairs), "")
        ratios.add_row("  smaller in", *(_number(pair[metric]["better"], 100) for pair in pairs), "% of scenarios")
    console.print(ratios)


def _table(files: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for file in files:
        table.add_column(file["name"], justify="right")
    table.add_column("")
    return table


def _number(value: float | None, factor: float) -> str:
    return "–" if value is None else f"{factor * value:.4g}"


def _interval(interval: Mapping[str, float | None]) -> str:
    if interval["estimate"] is None:
        return "–"
    estimate, low, high = (
        "–" if value is None else f"{value:.3g}" for value in (interval[key] for key in ("estimate", "low", "high"))
    )
    return f"{estimate} ({low}–{high})"
