"""Where the vehicle goes and how far it is off: Figures 5, 6, 9, 10, 13, 14, 17, 18."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

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
from dualwinch.simulation.plots.thin import peaks, thin, within
from dualwinch.simulation.result import Result

PREFIXES = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))
"""Units of length an error is shown in, the largest first."""

COMPARABLE = 10.0
"""Errors up to this many times the smallest controller's share a panel; a larger one is told in words."""

ZOOM = 0.4
"""Length in s of the stretch of a trajectory shown enlarged."""

INTERVALS = 200
"""Intervals of a run whose largest |e| is drawn on the logarithmic panel."""


def length_unit(largest: float) -> tuple[float, str]:
    """The unit (in m) and its name that show a length in m with few digits."""
    for unit, name in PREFIXES:
        if largest >= unit:
            return unit, name
    return PREFIXES[-1]


def trajectory(results: Mapping[str, Result]) -> Figure:
    """Position and speed against the reference, with a zoom on where they part most (Figures 5, 9, 13, 17).

    Args:
        results: controller → result, all of one case.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    results = ordered(results)
    first = next(iter(results.values()))
    with house_style():
        figure = new_figure(5.2, *headings(results, "trajectory", "tracking trajectory"))
        position, speed = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
        for axes, column, reference in ((position, "x", "x_ref"), (speed, "v", "v_ref")):
            shade(axes, first.experiment)
            _lines(axes, results, column)
            _reference(axes, first, reference)
        position.set_ylabel("position $x$ (m)")
        speed.set_ylabel("speed $v$ (m/s)")
        time_axis(position, first.experiment, named=False)
        time_axis(speed, first.experiment)
        _zoom(position, results, _late_steady_state(first.experiment))
        reference = Line2D([], [], color=INK, linestyle=":", label="reference")
        legend_below(figure, [*controller_handles(results), reference, steady_handle()])
    return figure


def error(results: Mapping[str, Result]) -> Figure:
    """Tracking error: whole run, largest magnitude on a logarithmic axis, steady state (Figures 6, 10, 14, 18).

    Args:
        results: controller → result, all of one case.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    results = ordered(results)
    first = next(iter(results.values())).experiment
    with house_style():
        figure = new_figure(5.4, *headings(results, "error", "tracking error"))
        panels = figure.subplot_mosaic([["whole", "whole"], ["decades", "steady"]], height_ratios=(1.05, 1))
        _whole_error(panels["whole"], results)
        _error_decades(panels["decades"], results)
        _steady_error(panels["steady"], results)
        shade(panels["whole"], first)
        shade(panels["decades"], first)
        legend_below(figure, [*controller_handles(results), steady_handle()])
    return figure


def _lines(axes: Axes, results: Mapping[str, Result], column: str, scale: float = 1.0) -> None:
    for kind, result in results.items():
        t, values = thin(result["t"], result[column] / scale)
        axes.plot(t, values, color=COLOURS[kind], linestyle=DASHES[kind], label=LAW_NAMES[kind])


def _reference(axes: Axes, result: Result, column: str) -> None:
    t, values = thin(result["t"], result[column])
    axes.plot(t, values, color=INK, linestyle=":", linewidth=1.0, label="reference")


def _late_steady_state(experiment: Experiment) -> tuple[float, float]:
    """Start and end in s of the last stretch of the steady state, where the lags that stay are seen."""
    end = min(experiment.steady_window[1], experiment.duration)
    return max(end - ZOOM, 0.0), end


def _zoom(axes: Axes, results: Mapping[str, Result], window: tuple[float, float]) -> None:
    first = next(iter(results.values()))
    inset = axes.inset_axes((0.69, 0.13, 0.29, 0.42))
    lowest, highest = np.inf, -np.inf
    for kind, result in [*results.items(), ("reference", first)]:
        rows = within(result["t"], *window)
        column = "x_ref" if kind == "reference" else "x"
        t, values = thin(result["t"][rows], result[column][rows])
        if np.isfinite(values).any():
            lowest, highest = min(lowest, np.nanmin(values)), max(highest, np.nanmax(values))
        inset.plot(t, values, color=COLOURS.get(kind, INK), linestyle=DASHES.get(kind, ":"), linewidth=1.0)
    inset.set_xlim(*window)
    inset.tick_params(labelsize=7, length=2)
    inset.set_title(f"{window[0]:g} to {window[1]:g} s, enlarged", fontsize=7.5, color=GREY, pad=3)
    if not highest > lowest:
        return
    inset.set_ylim(lowest, highest)
    axes.indicate_inset((window[0], lowest, window[1] - window[0], highest - lowest), edgecolor=INK)


def _whole_error(axes: Axes, results: Mapping[str, Result]) -> None:
    experiment = next(iter(results.values())).experiment
    unit, name = length_unit(_largest(results, "max_abs_error"))
    _lines(axes, results, "e", unit)
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    time_axis(axes, experiment)
    axes.set_title("whole run")
    axes.set_ylabel(rf"error $e = x - x_\mathrm{{ref}}$ ({name})")


def _error_decades(axes: Axes, results: Mapping[str, Result]) -> None:
    experiment = next(iter(results.values())).experiment
    width = experiment.duration / INTERVALS
    for kind, result in results.items():
        t, largest = peaks(result["t"], result["e"], width)
        axes.plot(t, largest, color=COLOURS[kind], linestyle=DASHES[kind], label=LAW_NAMES[kind])
    axes.set_yscale("log")
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, 1e-8), top)
    axes.yaxis.set_major_locator(LogLocator(base=10, numticks=12))
    axes.yaxis.set_minor_locator(NullLocator())
    time_axis(axes, experiment)
    axes.set_title(f"size of the error (largest in each {width:g} s)")
    axes.set_ylabel("$|e|$ (m)")


def _steady_error(axes: Axes, results: Mapping[str, Result]) -> None:
    experiment = next(iter(results.values())).experiment
    sizes = {kind: result.metrics.steady_max_abs_error for kind, result in results.items()}
    smallest = min((size for size in sizes.values() if np.isfinite(size)), default=np.nan)
    shown = {kind: result for kind, result in results.items() if sizes[kind] <= COMPARABLE * smallest}
    unit, name = length_unit(_largest(shown, "steady_max_abs_error"))
    start, end = experiment.steady_window
    left_out: list[str] = []
    for kind, result in results.items():
        rows = within(result["t"], start, end)
        t, values = thin(result["t"][rows], result["e"][rows])
        if kind in shown:
            axes.plot(t, values / unit, color=COLOURS[kind], linestyle=DASHES[kind], label=LAW_NAMES[kind])
        elif np.isfinite(values).any():
            scale, its_name = length_unit(sizes[kind])
            low, high = np.nanmin(values) / scale, np.nanmax(values) / scale
            span = f"{low:.3g} to {high:.3g}".replace("-", "−")
            left_out.append(f"{LAW_NAMES[kind]}: {span} {its_name}, off this panel")
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


def _largest(results: Mapping[str, Result], metric: str) -> float:
    values = [getattr(result.metrics, metric) for result in results.values()]
    return max((value for value in values if np.isfinite(value)), default=np.nan)
