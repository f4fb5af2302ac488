"""``dualwinch preload``: what preload costs, constant, scheduled, and at the least."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter
from rich import box
from rich.table import Table

from dualwinch.cli.doctor import versions
from dualwinch.cli.options import Assignments, Case, Config, Figure, Law, Plugins, use_parts
from dualwinch.cli.output import FIGURE_SUFFIXES, check_file, measured, styled, terminal, write_figure, write_json
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.simulation.analysis.preload import LeastPreload, Preloads
    from dualwinch.simulation.results.result import Result

app = App(
    name="preload",
    help_epilogue="""Examples:

    dualwinch preload --case 4 --plot preload.png
    dualwinch preload --case 4 --set controller.scheduled_preload.margin=150 --out preload.json
    dualwinch preload --config tuned/best.toml --least energy
    dualwinch preload --case 4 --set reference.jerk_limit=0.1 --torque-rate 30 --error 0.002
""",
)


@app.default
def preload(
    *,
    case: Case = None,
    config: Config = None,
    controller: Law = None,
    set_: Assignments = None,
    least: Annotated[
        Literal["load", "peak", "energy"],
        Parameter(help="What to minimise: continuous load, largest tension, or work of the motors."),
    ] = "load",
    error: Annotated[float, Parameter(help="Optimum: largest distance from the reference in m that is allowed.")] = 0.0,
    torque_rate: Annotated[
        float | None, Parameter(help="Optimum: largest rate of each motor torque in N m/s (default: any).")
    ] = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for all numbers: .json.")] = None,
    plot: Figure = None,
) -> None:
    """Compare a scheduled preload with constant ones and with the least possible.

    Runs the experiment with its preload kept constant, with the best constant preload of the same error and no smaller
    tensions, with the preload scheduled, and solves for the tensions over time that load the motors least. Prints for
    each of them load, tensions, work and error.
    """
    from dualwinch.config.experiment_file import experiment_from
    from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload
    from dualwinch.simulation.analysis.preload import preloads

    use_parts(plugin)
    scheduled = f"controller.coordination.kind={ScheduledPreload.kind}"
    asked = experiment_from(case, config, controller, [scheduled, *(set_ or [])])
    check_file(out, ".json")
    check_file(plot, *FIGURE_SUFFIXES)
    with ProgressLine("solving and simulating") as progress:
        found = preloads(asked, least, error=error, torque_rate=torque_rate, progress=progress)
    print_preloads(found)
    if out:
        write_json(out, as_json(found))
    if plot:
        from dualwinch.simulation.plots import preloads as figure

        write_figure(plot, figure(found))


COLUMNS = {
    "continuous_load": ("load\nN m", 1.0, ".3g"),
    "peak_tension": ("largest\nN", 1.0, ".0f"),
    "min_tension": ("smallest\nN", 1.0, ".0f"),
    "energy": ("work\nkJ", 1e-3, ".0f"),
    "chatter": ("chatter\nN", 1.0, ".2g"),
    "mse": ("MSE\nmm²", 1e6, ".3g"),
}
"""Figure of merit → heading, factor and format."""

POINTS = 1000
"""Points over time a file keeps of every run."""


def runs(found: Preloads) -> dict[str, Result]:
    """The runs there are, by name."""
    named = {"constant": found.constant, "best constant": found.best, "scheduled": found.scheduled}
    return {name: run for name, run in named.items() if run is not None}


def print_preloads(found: Preloads) -> None:
    """Print a row for every preload, and what the schedule saves."""
    console = terminal()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("preload", style="bold", no_wrap=True)
    table.add_column("N", justify="right", no_wrap=True)
    for heading, _, _ in COLUMNS.values():
        table.add_column(heading, justify="right", no_wrap=True)
    for name, run in runs(found).items():
        ended = "" if run.outcome == "completed" else f" ({run.outcome})"
        values = (measured(factor * run.metrics[column], form) for column, (_, factor, form) in COLUMNS.items())
        table.add_row(name + ended, _sums(name, run), *values)
    least, reached = found.least, _least_metrics(found.least)
    values = (measured(factor * reached.get(name, math.nan), form) for name, (_, factor, form) in COLUMNS.items())
    table.add_row("least", f"{least.preload.min():.0f}–{least.preload.max():.0f}", *values)
    console.print(table)
    if found.best is None:
        console.print("No constant preload has an error as small and keeps both ropes as taut as the schedule.")
        return
    over_best = _over_best(found)
    words = found.measure.replace("_", " ")
    console.print(
        styled(
            "bold",
            f"The schedule takes {over_best['scheduled']:.3g} of the {words}",
            " of the best constant preload that is as precise and keeps the ropes as taut; the least there could be is "
            f"{over_best['least']:.3g}: {100 * found.saved:.3g} % of what can be saved is saved.",
        ),
        soft_wrap=True,
    )


def _least_metrics(least: LeastPreload) -> dict[str, float]:
    """Figures of merit of the least preload, in their SI units."""
    return {
        "continuous_load": least.continuous_load,
        "peak_tension": least.peak_tension,
        "min_tension": float(min(least.F1.min(), least.F2.min())),
        "energy": least.energy,
        "mse": float((least.e**2).mean()),
    }


def _over_best(found: Preloads) -> dict[str, float]:
    """What schedule and least preload take of the measure, over what the best constant preload takes."""
    if found.best is None:
        return {}
    theirs = found.best.metrics[found.measure]
    ours, bound = found.scheduled.metrics[found.measure], getattr(found.least, found.measure)
    return {"scheduled": ours / theirs, "least": bound / theirs}


def _extremes(name: str, run: Result) -> list[float]:
    """Smallest and largest sum of tensions that a run asks for, in N."""
    if name != "scheduled":
        return [run.experiment.controller.limits.preload] * 2
    return [float(run["preload"].min()), float(run["preload"].max())]


def _sums(name: str, run: Result) -> str:
    first, last = _extremes(name, run)
    return f"{first:.0f}" if name != "scheduled" else f"{first:.0f}–{last:.0f}"


def as_json(found: Preloads) -> dict[str, Any]:
    """Everything as plain values; what is not finite becomes null."""
    from dualwinch.config.experiment_file import to_toml

    report: dict[str, Any] = {}
    for name, run in runs(found).items():
        stride = max(1, -(-len(run["t"]) // POINTS))
        report[name.replace(" ", "_")] = {
            "outcome": str(run.outcome),
            "preload": run.experiment.controller.limits.preload,
            "preload_extremes": _extremes(name, run),
            "metrics": {key: _plain(run.metrics[key]) for key in run.metrics},
            "curves": {key: [_plain(value) for value in run[key][::stride]] for key in ("t", "F1", "F2", "e")},
        }
    least = found.least
    report["least"] = {
        "metrics": _least_metrics(least),
        "preload_extremes": [float(least.preload.min()), float(least.preload.max())],
        "curves": {key: getattr(least, key).tolist() for key in ("t", "F1", "F2", "e")},
    }
    return report | {
        "measure": found.measure,
        "saved_share": _plain(found.saved),
        "measure_over_best_constant": _over_best(found),
        "units": {
            "t": "s",
            "F1": "N",
            "F2": "N",
            "e": "m",
            "preload": "N",
            "preload_extremes": "N",
            "saved_share": "1",
            "measure_over_best_constant": "1",
        }
        | {name: quantity.unit for name, quantity in found.scheduled.metrics.quantities.items()},
        "configuration": to_toml(found.scheduled.experiment),
        "versions": versions(),
    }


def _plain(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
