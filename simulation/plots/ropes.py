"""What the ropes are asked for and what they give: Figures 7, 8, 11, 12, 15, 16, 19, 20."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.between_samples import finely
from dualwinch.simulation.plots.curves import Curve, Runs, curves, longest
from dualwinch.simulation.plots.headings import headings
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import GREY, INK, house_style, shade, steady_handle
from dualwinch.simulation.plots.thin import within
from dualwinch.simulation.results.result import Result

KILO = 1e3

START_UP = 0.06
"""Seconds of a uniform reference's start that are shown enlarged: the speed step sets the ropes ringing."""

BRAKING = (-0.03, 0.12)
"""Seconds around the start of a profile's braking that are shown enlarged: its acceleration jumps there."""

SMALLEST_SPAN = 0.4
"""Smallest height in kN of an enlarged panel, so that fractions of a newton do not look like an event."""

OVERSHOOT = 1.02
"""A tension this many times its limit is worth a word."""


def commands(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Tension commands of the coordination, a panel a rope, with their limits (Figures 7, 11, 15, 19).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for rope 1 and rope 2, and for their enlarged stretches; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    words = "force commands of the coordination"
    return _two_ropes(curves(results), "commands", words, "command", ax)


def tensions(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Rope tensions, a panel a rope, with the limits of the commands, the peak and the slack (Figures 8, 12, 16, 20).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for rope 1 and rope 2, and for their enlarged stretches; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    return _two_ropes(curves(results), "tensions", "rope tensions", "tension", ax)


def enlarged(experiment: Experiment) -> tuple[float, float, float, str]:
    """The stretch of a run that deserves a zoom.

    Returns:
        Its start and end in s, the time in s its axis counts from, and what happens there.
    """
    if experiment.reference.kind == "uniform":
        return 0.0, START_UP, 0.0, "start-up"
    reference = experiment.reference
    joint = reference.cruise_until if reference.kind == "profile" else experiment.steady_window[1]
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


COLUMNS = {"command": ("F1_cmd", "F2_cmd"), "tension": ("F1", "F2")}
"""What is drawn → its columns, rope 1 and rope 2."""


def _two_ropes(runs: Sequence[Curve], content: str, words: str, quantity: str, ax: GivenAxes) -> Figure:
    experiment = runs[0].experiment
    zoomed = enlarged(experiment)[0] < experiment.duration
    draw = [partial(_whole_run, quantity=quantity, rope=rope) for rope in (1, 2)]
    if zoomed:
        draw += [partial(_enlarged_run, quantity=quantity, rope=rope) for rope in (1, 2)]
    with house_style():
        page = Page(ax, 5.2, *headings([run.experiment for run in runs], content, words))
        panels = page.panels(2, 1 + zoomed, sharex="col", width_ratios=(2.3, 1)[: 1 + zoomed])
        for axes, panel in zip(panels, draw, strict=False):
            panel(axes, runs)
        page.time_axes(panels[:2], longest(runs))
        _start, _end, origin, event = enlarged(experiment)
        for axes in panels[2:3]:
            axes.set_title(event + ", enlarged")
        for axes in panels[2:][-1:]:
            axes.set_xlabel(f"time after {origin:g} s (ms)" if origin else "time (ms)")
        page.legend([*(run.handle for run in runs), limit_handle(experiment), steady_handle()])
    return page.figure


def _whole_run(axes: Axes, runs: Sequence[Curve], quantity: str, rope: int) -> None:
    column = COLUMNS[quantity][rope - 1]
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, run.result["t"], run.result[column] / KILO)
    draw_limits(axes, runs[0].experiment)
    axes.set_ylabel(f"{quantity} $F_{rope}$ (kN)")
    axes.set_title(f"rope {rope}")
    if quantity == "tension":
        axes.set_title(_extremes(runs, column), loc="right", fontsize=7.5, color=GREY)


def _enlarged_run(axes: Axes, runs: Sequence[Curve], quantity: str, rope: int) -> None:
    """Commands as they are held from sample to sample, tensions as they ring between samples."""
    experiment = runs[0].experiment
    start, end, origin, _event = enlarged(experiment)
    for run in runs:
        rows = within(run.result["t"], start, end)
        if quantity == "tension":
            t, *forces = finely(run.result, rows)
            run.draw(axes, (t - origin) * 1e3, forces[rope - 1] / KILO)
        else:
            command = run.result[COLUMNS[quantity][rope - 1]][rows] / KILO
            run.draw(axes, (run.result["t"][rows] - origin) * 1e3, command, drawstyle="steps-post")
    axes.set_xlim((start - origin) * 1e3, (min(end, experiment.duration) - origin) * 1e3)
    bottom, top = axes.get_ylim()
    spare = max(SMALLEST_SPAN - (top - bottom), 0.0) / 2
    draw_limits(axes, experiment)
    axes.set_ylim(bottom - spare, top + spare)


def _extremes(runs: Sequence[Curve], column: str) -> str:
    """Say in words what a line of a few milliseconds cannot show at this width."""
    limit = runs[0].experiment.controller.limits.tension_max
    drawn = [run for run in runs if np.isfinite(run.result[column]).any()]
    if not drawn:
        return ""
    slack = [(run.label, _slack_time(run.result, column)) for run in drawn]
    if any(time for _, time in slack):
        return "slack: " + ", ".join(f"{label} {_moment(time)}" for label, time in slack if time)
    peaks = [float(np.nanmax(run.result[column])) for run in drawn]
    highest = max(peaks)
    if highest <= OVERSHOOT * limit:
        return ""
    first = drawn[peaks.index(highest)].result
    at = first["t"][np.nanargmax(first[column])]
    reached = [run.label for run, peak in zip(drawn, peaks, strict=True) if f"{peak:.3g}" == f"{highest:.3g}"]
    return f"peak {highest / KILO:.2f} kN at {_moment(at)} ({', '.join(reached)})"


def _slack_time(result: Result, column: str) -> float:
    spacing = result["t"][1] - result["t"][0] if len(result["t"]) > 1 else 0.0
    return float(np.count_nonzero(result[column] <= 0) * spacing)


def _moment(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
