"""``dualwinch compare``: files of gains in the same scenarios, with paired statistics."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from dualwinch.codegen.files import atomic
from dualwinch.commands.doctor import versions
from dualwinch.commands.output import check_folder, check_plot, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.config.ensemble_file import ensemble_to_toml, load_ensemble, reset
from dualwinch.config.experiment_file import load
from dualwinch.config.toml_text import parse_assignment
from dualwinch.controllers.controller import Controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.comparison import CONFIDENCE, RESAMPLES, Comparison, paper_controller
from dualwinch.simulation.ensembles.comparison import compare as run
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment

PAPER = "paper"
"""Name that stands for the paper's gains instead of a file."""

SCENARIOS, SEED = 200, 0
"""How many scenarios are drawn, and from which seed, where nothing else is asked for."""

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
    if not names:
        raise ConfigurationError(f"give at least one file of gains, or '{PAPER}' for the paper's")
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise ConfigurationError(f"{twice}: given twice")
    return {name: paper_controller() if name == PAPER else load(Path(name)).controller for name in names}


def ensemble(name: str, config: str | Path | None, assignments: Sequence[str]) -> Ensemble:
    """The ensemble a command line asks for.

    Raises:
        ConfigurationError: anything wrong with the ensemble, a key or a value, or a key of the controller.
    """
    values = dict(map(parse_assignment, assignments))
    for key in values:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: the controller comes from the files of gains; set it there")
    return reset(load_ensemble(name, load(Path(config)) if config else Experiment()), values)


def compare(
    names: Sequence[str],
    *,
    ensemble_name: str = "sea",
    config: str | Path | None = None,
    assignments: Sequence[str] = (),
    scenarios: int = SCENARIOS,
    seed: int = SEED,
    out: str | Path | None = None,
    plot: str | Path | None = None,
) -> None:
    """Run, print, write. Everything that can be wrong with the files is found before the run."""
    wanted, drawn = controllers(names), ensemble(ensemble_name, config, assignments)
    out, plot = (Path(file) if file else None for file in (out, plot))
    if out:
        if out.suffix.lower() != ".json":
            raise ConfigurationError(f"{out.name}: unknown suffix {out.suffix!r}; must be .json")
        check_folder(out.parent)
    check_plot(plot)
    console = terminal(stderr=True)
    with ProgressLine("simulating") as progress:
        result = run(wanted, drawn, scenarios, seed, progress=progress)
        progress(0.0, "finding infeasible scenarios")
        facts = as_json(result)
    print_comparison(result, facts)
    if out:
        with atomic(out) as unfinished:
            unfinished.write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import comparison
        from dualwinch.simulation.plots import save as save_figure

        save_figure(comparison(result), plot)
        console.print(f"wrote {plot}")
    if result.partial:
        raise KeyboardInterrupt


def as_json(result: Comparison) -> dict[str, Any]:
    """Everything the comparison says, JSON-ready: NaN becomes null."""
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
