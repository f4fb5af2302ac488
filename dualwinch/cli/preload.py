"""The command ``preload``: motor load of constant, scheduled and optimal preload."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dualwinch.cli.options import ControllerOptions, Figure
from dualwinch.cli.output import (
    FigureColumn,
    FigureTable,
    check_file,
    print_note,
    styled,
    terminal,
    versions,
    write_figure,
    write_json,
)
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dualwinch.analysis.preload import Preloads
    from dualwinch.simulation.experiment import Experiment


def preload(
    *,
    given: ControllerOptions = ControllerOptions(),
    minimise: Literal["load", "peak", "energy"] = "load",
    error: float = 0.0,
    torque_rate: float | None = None,
    out: Path | None = None,
    plot: Figure = None,
) -> None:
    """Compare a scheduled preload with constant ones and with the optimum.

    Runs the experiment with its own constant preload, with the best constant preload that has no larger error and no
    smaller tensions than the schedule, and with the preload scheduled, and solves for the tensions over time that load
    the motors least. Prints load, tensions, work and error of each. Constant preloads have differential tension; an
    experiment with another coordination is first run as it is.

    Args:
        minimise: What to minimise: continuous load, largest tension, or work of the motors.
        error: Optimum: largest allowed distance from the reference in m.
        torque_rate: Optimum: largest rate of each motor torque in N m/s (default: any).
        out: File for all numbers: .json.

    Examples:
        dualwinch preload --case 4 --plot preload.png
        dualwinch preload --case 4 --set controller.scheduled_preload.margin=150 --out preload.json
        dualwinch preload --config tuned/best.toml --minimise energy
        dualwinch preload --case 4 --set reference.jerk_limit=0.1 --torque-rate 30 --error 0.002
    """
    from dualwinch.analysis.preload import preloads
    from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload

    experiment = given.experiment(f"{COORDINATION}={ScheduledPreload.kind}")
    check_file(out, ".json")
    with ProgressLine("solving and simulating", command="preload", patient=True) as progress:
        comparison = preloads(
            experiment,
            minimise,
            error=error,
            torque_rate=torque_rate,
            configured=_as_configured(given, experiment),
            progress=progress,
        )
    record = to_record(comparison, given.typed)
    print_preloads(record, comparison)
    write_json(out, record)
    write_figure(plot, "preloads", comparison)


COORDINATION = "controller.coordination.kind"
"""Key that this command sets by default."""


def _as_configured(given: ControllerOptions, scheduled: Experiment) -> Experiment:
    """The experiment of the options with the coordination of case or file, without settings of the schedule."""
    from dualwinch.config.experiment_file import experiment_from
    from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload

    if COORDINATION in given.values:
        return scheduled
    prefix = f"controller.{ScheduledPreload.table()}."
    before = experiment_from(given.case, given.config)
    if isinstance(before.controller.coordination, ScheduledPreload):
        return scheduled
    return experiment_from(
        given.case, given.config, None, [words for words in given.assignments if not words.strip().startswith(prefix)]
    )


PRINTED = ("continuous_load", "peak_tension", "min_tension", "energy", "chatter", "mse")
"""Figures of merit that are printed."""

FILE_POINTS = 1000
"""Most points over time of each run in a file."""


def print_preloads(record: dict[str, Any], found: Preloads) -> None:
    """Print a row for every preload, the saving of the schedule, and remarks on its run."""
    console, merits = terminal(), found.scheduled.metrics.quantities
    columns = [FigureColumn("preload", ""), FigureColumn("preload_extremes", "N", "N")]
    columns += [FigureColumn.of_metric(name, merits[name]) for name in PRINTED]
    rows = []
    for name in (*found.runs, "optimum"):
        run = record[name.replace(" ", "_")]
        outcome = run.get("outcome", "completed")
        ended = "" if outcome == "completed" else f" ({outcome})"
        extremes = "–".join(dict.fromkeys(f"{end:.0f}" for end in run["preload_extremes"]))
        rows.append([name + ended, extremes, *(run["metrics"].get(metric, math.nan) for metric in PRINTED)])
    console.print(FigureTable("preloads", columns, rows).render())
    if found.configured is not None:
        console.print(_coordinations(found), soft_wrap=True, highlight=False)
    if found.best is None:
        console.print("No constant preload has an error as small as the schedule's and keeps both ropes as taut.")
    else:
        over_best = record["measure_over_best_constant"]
        share = f"The schedule takes {over_best['scheduled']:.3g} of the {found.measure.replace('_', ' ')}"
        saved = f"{100 * found.saved:.3g} % of the possible saving" if found.saved > 0 else "no saving"
        words = (
            " of the best constant preload that is as precise and keeps the ropes as taut; the optimum is "
            f"{over_best['optimum']:.3g}: {saved}."
        )
        console.print(styled("bold", share, words), soft_wrap=True)
    for words in record["remarks"]:
        print_note(words)


def _coordinations(found: Preloads) -> str:
    """Which coordination each run has, where that of the experiment is another one."""
    kinds = {name: run.experiment.controller.coordination.kind for name, run in found.runs.items()}
    configured, constant, scheduled = kinds["as configured"], kinds["constant"], kinds["scheduled"]
    constants = "constant" if found.best is None else "constant and best constant"
    share = "shares" if found.best is None else "share"
    return (
        f"as configured: {configured}, as `simulate` runs it; {constants} {share} the force by {constant}, scheduled "
        f"by {scheduled}, each with the gains that it has in common with {configured}."
    )


def to_record(found: Preloads, typed: str) -> dict[str, Any]:
    """The preloads as plain data; commands in remarks have the options `typed`."""
    from dualwinch.analysis.remarks import in_full, remarks
    from dualwinch.config.experiment_file import to_toml

    report: dict[str, Any] = {}
    for name, run in found.runs.items():
        stride, preload = max(1, -(-len(run["t"]) // FILE_POINTS)), run.experiment.controller.limits.preload
        report[name.replace(" ", "_")] = {
            "outcome": str(run.outcome),
            "coordination": run.experiment.controller.coordination.kind,
            "preload": preload,
            "preload_extremes": _extremes(run["preload"]) if "preload" in run.columns else [preload] * 2,
            "metrics": dict(run.metrics),
            "curves": {key: run[key][::stride] for key in ("t", "F1", "F2", "e")},
        }
    optimum = found.optimum
    report["optimum"] = {
        "metrics": {
            "continuous_load": optimum.continuous_load,
            "peak_tension": optimum.peak_tension,
            "min_tension": float(min(optimum.F1.min(), optimum.F2.min())),
            "energy": optimum.energy,
            "mse": float((optimum.e**2).mean()),
        },
        "preload_extremes": _extremes(optimum.preload),
        "curves": {key: getattr(optimum, key) for key in ("t", "F1", "F2", "e")},
    }
    over_best = {}
    if found.best is not None:
        best = found.best.metrics[found.measure]
        scheduled, bound = found.scheduled.metrics[found.measure], getattr(optimum, found.measure)
        over_best = {"scheduled": scheduled / best, "optimum": bound / best}
    units = {"t": "s", "F1": "N", "F2": "N", "e": "m", "preload": "N", "preload_extremes": "N"}
    units |= dict.fromkeys(("saved_share", "measure_over_best_constant"), "1")
    return report | {
        "measure": found.measure,
        "saved_share": found.saved,
        "measure_over_best_constant": over_best,
        "remarks": [in_full(words, typed) for words in remarks(found.scheduled)],
        "units": units | {name: quantity.unit for name, quantity in found.scheduled.metrics.quantities.items()},
        "configuration": to_toml(found.scheduled.experiment),
        "versions": versions(),
    }


def _extremes(preload: NDArray[np.float64]) -> list[float]:
    """Smallest and largest preload, the commanded sum of tensions, in N."""
    return [float(preload.min()), float(preload.max())]
