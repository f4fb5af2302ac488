"""What the ropes are asked for and what they give: Figures 7, 8, 11, 12, 15, 16, 19, 20."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.style import (
    COLOURS,
    DASHES,
    GREY,
    INK,
    LAW_NAMES,
    controller_handles,
    headings,
    house_style,
    legend_below,
    new_figure,
    ordered,
    shade,
    steady_handle,
    time_axis,
)
from dualwinch.simulation.plots.thin import thin, within
from dualwinch.simulation.result import Result

KILO = 1e3

START_UP = 0.06
"""Seconds of a uniform reference's start that are shown enlarged: the speed step sets the ropes ringing."""

BRAKING = (-0.03, 0.12)
"""Seconds around the start of a profile's braking that are shown enlarged: its acceleration jumps there."""

SMALLEST_SPAN = 0.4
"""Smallest height in kN of an enlarged panel, so that fractions of a newton do not look like an event."""

OVERSHOOT = 1.02
"""A tension this many times its limit is worth a word."""


def commands(results: Mapping[str, Result]) -> Figure:
    """Tension commands of the coordination, a panel a rope, with their limits (Figures 7, 11, 15, 19).

    Args:
        results: controller → result, all of one case.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    words = "force commands of the coordination"
    return _two_ropes(results, "commands", words, ("F1_cmd", "F2_cmd"), "command")


def tensions(results: Mapping[str, Result]) -> Figure:
    """Rope tensions, a panel a rope, with the limits of the commands, the peak and the slack (Figures 8, 12, 16, 20).

    Args:
        results: controller → result, all of one case.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    return _two_ropes(results, "tensions", "rope tensions", ("F1", "F2"), "tension")


def enlarged(experiment: Experiment) -> tuple[float, float, float, str]:
    """The stretch of a run that deserves a zoom.

    Returns:
        Its start and end in s, the time in s its axis counts from, and what happens there.
    """
    if experiment.reference.kind == "uniform":
        return 0.0, START_UP, 0.0, "start-up"
    joint = experiment.reference.cruise_until
    return joint + BRAKING[0], joint + BRAKING[1], joint, "braking begins"


def draw_limits(axes: Axes, experiment: Experiment) -> None:
    """Draw the limits of the tension commands on an axis in kN."""
    limits = experiment.controller.limits
    for limit in (limits.tension_min, limits.tension_max):
        axes.axhline(limit / KILO, color=INK, linestyle=(0, (2, 2)), linewidth=0.8, zorder=1.5)


def limit_handle(experiment: Experiment) -> Line2D:
    """Legend entry of the limits."""
    limits = experiment.controller.limits
    words = f"limits {limits.tension_min / KILO:g} and {limits.tension_max / KILO:g} kN"
    return Line2D([], [], color=INK, linestyle=(0, (2, 2)), linewidth=0.8, label=words)


def _two_ropes(
    results: Mapping[str, Result], content: str, words: str, columns: tuple[str, str], quantity: str
) -> Figure:
    results = ordered(results)
    experiment = next(iter(results.values())).experiment
    zoomed = enlarged(experiment)[0] < experiment.duration
    with house_style():
        figure = new_figure(5.2, *headings(results, content, words))
        panels = figure.subplots(2, 1 + zoomed, sharex="col", squeeze=False, width_ratios=(2.3, 1)[: 1 + zoomed])
        for rope, (row, column) in enumerate(zip(panels, columns, strict=True), start=1):
            _whole_run(row[0], results, column)
            row[0].set_ylabel(f"{quantity} $F_{rope}$ (kN)")
            row[0].set_title(f"rope {rope}")
            if quantity == "tension":
                row[0].set_title(_extremes(results, column), loc="right", fontsize=7.5, color=GREY)
            if zoomed:
                _enlarged_run(row[1], results, column)
        time_axis(panels[1][0], experiment)
        if zoomed:
            _start, _end, origin, event = enlarged(experiment)
            panels[0][1].set_title(event + ", enlarged")
            panels[1][1].set_xlabel(f"time after {origin:g} s (ms)" if origin else "time (ms)")
        handles: list[Line2D | Patch] = [
            *controller_handles(results),
            limit_handle(experiment),
            steady_handle(),
        ]
        legend_below(figure, handles)
    return figure


def _whole_run(axes: Axes, results: Mapping[str, Result], column: str) -> None:
    experiment = next(iter(results.values())).experiment
    shade(axes, experiment)
    for kind, result in results.items():
        t, force = thin(result["t"], result[column] / KILO)
        axes.plot(t, force, color=COLOURS[kind], linestyle=DASHES[kind], label=LAW_NAMES[kind])
    draw_limits(axes, experiment)


def _enlarged_run(axes: Axes, results: Mapping[str, Result], column: str) -> None:
    experiment = next(iter(results.values())).experiment
    start, end, origin, _event = enlarged(experiment)
    for kind, result in results.items():
        rows = within(result["t"], start, end)
        t, force = thin(result["t"][rows], result[column][rows] / KILO)
        axes.plot((t - origin) * 1e3, force, color=COLOURS[kind], linestyle=DASHES[kind], label=LAW_NAMES[kind])
    axes.set_xlim((start - origin) * 1e3, (min(end, experiment.duration) - origin) * 1e3)
    bottom, top = axes.get_ylim()
    spare = max(SMALLEST_SPAN - (top - bottom), 0.0) / 2
    draw_limits(axes, experiment)
    axes.set_ylim(bottom - spare, top + spare)


def _extremes(results: Mapping[str, Result], column: str) -> str:
    """Say in words what a line of a few milliseconds cannot show at this width."""
    limit = next(iter(results.values())).experiment.controller.limits.tension_max
    drawn = {kind: result for kind, result in results.items() if np.isfinite(result[column]).any()}
    if not drawn:
        return ""
    slack = {LAW_NAMES[kind]: _slack_time(result, column) for kind, result in drawn.items()}
    if any(slack.values()):
        return "slack: " + ", ".join(f"{name} {_moment(time)}" for name, time in slack.items() if time)
    peaks = {kind: float(np.nanmax(result[column])) for kind, result in drawn.items()}
    kind = max(peaks, key=lambda kind: peaks[kind])
    if peaks[kind] <= OVERSHOOT * limit:
        return ""
    at = drawn[kind]["t"][np.nanargmax(drawn[kind][column])]
    reached = [LAW_NAMES[other] for other in peaks if f"{peaks[other]:.3g}" == f"{peaks[kind]:.3g}"]
    return f"peak {peaks[kind] / KILO:.2f} kN at {_moment(at)} ({', '.join(reached)})"


def _slack_time(result: Result, column: str) -> float:
    spacing = result["t"][1] - result["t"][0] if len(result["t"]) > 1 else 0.0
    return float(np.count_nonzero(result[column] <= 0) * spacing)


def _moment(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
