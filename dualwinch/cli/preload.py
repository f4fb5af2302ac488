"""The command ``preload``: motor load of constant, scheduled and optimal preload."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dualwinch.cli.options import ControllerOptions, Figure
from dualwinch.cli.output import check_file, print_figures, print_remarks, versions, write_figure, write_json
from dualwinch.cli.progress import ProgressLine
from dualwinch.model.quantities.figures import to_record

if TYPE_CHECKING:
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
        dualwinch preload --case 4 --set controller.scheduled_preload.margin=0.025 --out preload.json
        dualwinch preload --config tuned/best.toml --minimise energy
        dualwinch preload --case 4 --set reference.jerk_limit=0.1 --torque-rate 30 --error 0.002
    """
    from dualwinch.analysis.preload import preloads
    from dualwinch.analysis.remarks import in_full
    from dualwinch.config.experiment_file import to_toml
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
    notes = [in_full(words, given.typed) for words in comparison.remarks]
    print_figures(comparison.figures)
    print_remarks(notes)
    facts = {"remarks": notes, "notes": to_record(comparison.figures)["notes"]}
    facts |= {"configuration": to_toml(comparison.scheduled.experiment), "versions": versions()}
    write_json(out, comparison.to_record() | facts)
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
