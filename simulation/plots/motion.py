"""Where the vehicle goes and how far it is off: Figures 5, 6, 9, 10, 13, 14, 17, 18."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.curves import Curve, Runs, curves, longest
from dualwinch.simulation.plots.headings import headings
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import GREY, INK, house_style, shade, steady_handle, time_axis
from dualwinch.simulation.plots.thin import drawable, largest, peaks, thin, within

PREFIXES = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))
"""Units of length an error is shown in, the largest first."""

COMPARABLE = 10.0
"""Errors up to this many times the smallest controller's share a panel; a larger one is told in words."""

ZOOM = 0.4
"""Length in s of the stretch of a trajectory shown enlarged."""

INTERVALS = 200
"""Intervals of a run whose largest |e| is drawn on the logarithmic panel."""

REFERENCE = {"color": INK, "linestyle": ":", "linewidth": 1.0, "label": "reference"}
"""How a reference is drawn."""


def length_unit(largest: float) -> tuple[float, str]:
    """The unit (in m) and its name that show a length in m with few digits."""
    for unit, name in PREFIXES:
        if largest >= unit:
            return unit, name
    return PREFIXES[-1]


def trajectory(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Position and speed against the reference, with a zoom on where they part most (Figures 5, 9, 13, 17).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for the position and the speed; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    runs = curves(results)
    with house_style():
        page = Page(ax, 5.2, *headings([run.experiment for run in runs], "trajectory", "tracking trajectory"))
        panels = page.panels(2, sharex=True, height_ratios=(1.6, 1))
        for axes, draw in zip(panels, (_position, _speed), strict=False):
            draw(axes, runs)
        page.time_axes(panels, longest(runs))
        reference = Line2D([], [], color=INK, linestyle=":", label="reference")
        page.legend([*(run.handle for run in runs), reference, steady_handle()])
    return page.figure


def error(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Tracking error: whole run, largest magnitude on a logarithmic axis, steady state (Figures 6, 10, 14, 18).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for these three; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    runs = curves(results)
    with house_style():
        page = Page(ax, 5.4, *headings([run.experiment for run in runs], "error", "tracking error"))
        panels = page.mosaic([["whole", "whole"], ["decades", "steady"]], height_ratios=(1.05, 1))
        for axes, draw in zip(panels, (_whole_error, _error_decades, _steady_error), strict=False):
            draw(axes, runs)
        page.legend([*(run.handle for run in runs), steady_handle()])
    return page.figure


def _position(axes: Axes, runs: Sequence[Curve]) -> None:
    _against_reference(axes, runs, "x", "x_ref")
    axes.set_ylabel("position $x$ (m)")
    _zoom(axes, runs, _late_steady_state(runs[0].experiment))


def _speed(axes: Axes, runs: Sequence[Curve]) -> None:
    _against_reference(axes, runs, "v", "v_ref")
    axes.set_ylabel("speed $v$ (m/s)")


def _against_reference(axes: Axes, runs: Sequence[Curve], column: str, reference: str) -> None:
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, run.result["t"], run.result[column])
    for run in _references(runs):
        run.draw(axes, run.result["t"], run.result[reference], **REFERENCE)


def _references(runs: Sequence[Curve]) -> list[Curve]:
    """A run of every reference."""
    found: dict[object, Curve] = {}
    for run in runs:
        found.setdefault((run.experiment.reference, run.experiment.duration), run)
    return list(found.values())


def _late_steady_state(experiment: Experiment) -> tuple[float, float]:
    """Start and end in s of the last stretch of the steady state, where the lags that stay are seen."""
    end = min(experiment.steady_window[1], experiment.duration)
    return max(end - ZOOM, 0.0), end


def _zoom(axes: Axes, runs: Sequence[Curve], window: tuple[float, float]) -> None:
    inset = axes.inset_axes((0.69, 0.13, 0.29, 0.42))
    lowest, highest = np.inf, -np.inf
    lines = [(run, "x", {"linewidth": 1.0}) for run in runs]
    lines += [(run, "x_ref", REFERENCE) for run in _references(runs)]
    for run, column, style in lines:
        rows = within(run.result["t"], *window)
        t, values = thin(run.result["t"][rows], run.result[column][rows])
        if np.isfinite(values).any():
            lowest, highest = min(lowest, np.nanmin(values)), max(highest, np.nanmax(values))
        run.draw(inset, t, values, **style)
    inset.set_xlim(*window)
    inset.tick_params(labelsize=7, length=2)
    inset.set_title(f"{window[0]:g} to {window[1]:g} s, enlarged", fontsize=7.5, color=GREY, pad=3)
    if not highest > lowest:
        return
    inset.set_ylim(lowest, highest)
    axes.indicate_inset((window[0], lowest, window[1] - window[0], highest - lowest), edgecolor=INK)


def _whole_error(axes: Axes, runs: Sequence[Curve]) -> None:
    unit, name = length_unit(max(largest(run.result["e"]) for run in runs))
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, run.result["t"], run.result["e"] / unit)
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    time_axis(axes, longest(runs))
    axes.set_title("whole run")
    axes.set_ylabel(rf"error $e = x - x_\mathrm{{ref}}$ ({name})")


def _error_decades(axes: Axes, runs: Sequence[Curve]) -> None:
    experiment = longest(runs)
    width = experiment.duration / INTERVALS
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, *peaks(run.result["t"], run.result["e"], width))
    axes.set_yscale("log")
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, 1e-8), top)
    axes.yaxis.set_major_locator(LogLocator(base=10, numticks=12))
    axes.yaxis.set_minor_locator(NullLocator())
    time_axis(axes, experiment)
    axes.set_title(f"size of the error (largest in each {width:g} s)")
    axes.set_ylabel("$|e|$ (m)")


def _steady_error(axes: Axes, runs: Sequence[Curve]) -> None:
    experiment = runs[0].experiment
    start, end = experiment.steady_window
    rows = [within(run.result["t"], start, end) for run in runs]
    sizes = [largest(run.result["e"][part]) for run, part in zip(runs, rows, strict=True)]
    smallest = min((size for size in sizes if size > 0), default=0.0)
    unit, name = length_unit(max((size for size in sizes if size <= COMPARABLE * smallest), default=np.nan))
    left_out: list[str] = []
    for run, part, size in zip(runs, rows, sizes, strict=True):
        values = run.result["e"][part]
        if size <= COMPARABLE * smallest:
            run.draw(axes, run.result["t"][part], values / unit)
        else:
            scale, its_name = length_unit(size)
            shown = drawable(values) / scale
            span = f"{np.nanmin(shown):.3g} to {np.nanmax(shown):.3g}".replace("-", "−")
            left_out.append(f"{run.label}: {span} {its_name}, off this panel")
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    axes.set_xlim(start, max(end, start + experiment.simulation.sample_time))
    if left_out:
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom, top + 0.16 * len(left_out) * (top - bottom))
        axes.text(0.02, 0.97, "\n".join(left_out), transform=axes.transAxes, va="top", fontsize=7.5)
    axes.set_facecolor("#FAFAFA")
    axes.set_title("steady-state window")
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"error $e$ ({name})")
