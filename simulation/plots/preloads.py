"""Four preloads of a run: sum of the tensions, tension of the slacker rope, error."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.simulation.analysis.preload import Preloads
from dualwinch.simulation.plots.headings import scenario
from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import BLUE, GREEN, GREY, INK, VERMILION, house_style
from dualwinch.simulation.plots.thin import Floats, largest, thin

COLOURS = {"constant": GREY, "best constant": VERMILION, "scheduled": BLUE}
"""Run → colour."""

OPTIMUM = {"color": GREEN, "linestyle": (0, (4, 2)), "linewidth": 1.0}
"""How the least preload is drawn."""


def preloads(found: Preloads, *, ax: GivenAxes = None) -> Figure:
    """Sum of both tensions, the smaller of them, and the error, of every preload over time.

    Args:
        found: the preloads.
        ax: axes for the three panels; default: a figure of its own.
    """
    runs = {"constant": found.constant, "best constant": found.best, "scheduled": found.scheduled}
    kept = {name: run for name, run in runs.items() if run is not None}
    experiment = found.scheduled.experiment
    loads = ", ".join(f"{name} {run.metrics.continuous_load:.1f}" for name, run in kept.items())
    words = f"Continuous load in N m: {loads}, least {found.least.continuous_load:.1f}"
    with house_style():
        page = Page(ax, 5.8, f"What preload costs: {scenario(experiment)}", words)
        panels = page.panels(3, sharex=True, height_ratios=(1.3, 1, 1))
        unit, name_of_unit = length_unit(max(largest(run["e"]) for run in kept.values()))
        for name, run in kept.items():
            t, F1, F2 = run["t"], run["F1"], run["F2"]
            for axes, values in zip(panels, ((F1 + F2) / 1e3, np.minimum(F1, F2) / 1e3, run["e"] / unit), strict=False):
                _draw(axes, t, values, COLOURS[name])
        least = found.least
        for axes, values in zip(panels, (least.preload, np.minimum(least.F1, least.F2)), strict=False):
            axes.plot(least.t, values / 1e3, **OPTIMUM)
        labels = ("sum of tensions (kN)", "smaller tension (kN)", f"error $e$ ({name_of_unit})")
        for axes, label in zip(panels, labels, strict=False):
            axes.set_ylabel(label)
        for axes in panels[1:2]:
            axes.axhline(experiment.controller.limits.tension_min / 1e3, color=INK, linewidth=0.7, linestyle=":")
        page.time_axes(panels, experiment)
        page.align()
        handles = [Line2D([], [], color=COLOURS[name], label=_words(name, found)) for name in kept]
        page.legend([*handles, Line2D([], [], label="least there could be", **OPTIMUM)])
    return page.figure


def _draw(axes: Axes, t: Floats, values: Floats, colour: str) -> None:
    axes.plot(*thin(t, values), color=colour, linewidth=1.0)


def _words(name: str, found: Preloads) -> str:
    run = {"constant": found.constant, "best constant": found.best}.get(name)
    return name if run is None else f"{name}, {run.experiment.controller.limits.preload:.0f} N"
