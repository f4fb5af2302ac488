"""Controllers in the same scenarios at a glance: how their errors and chatter spread, and the ratios of their means."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from dualwinch.simulation.ensembles.paired import COMPARED, CONFIDENCE, Comparison
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    house_style,
    legend_below,
    new_figure,
)

COLOURS = (GREY, BLUE, VERMILION, GREEN, PURPLE, GOLD, WINE, SKY)
"""One a controller, the first being what the others are compared with; then from the start again."""

PANELS = (("mse", "mean square error (mm²)", 1e6), ("chatter", "chatter (N/sample)", 1.0))
"""Figure of merit, axis and factor of the panels that show the scenarios."""

FEW_DECADES = 300
"""Ratio of an axis's ends up to which numbers between powers of ten have room."""


def comparison(result: Comparison) -> Figure:
    """Shares of scenarios up to an error and a chatter, and ratios to the first controller with their intervals."""
    colours = {name: COLOURS[place % len(COLOURS)] for place, name in enumerate(result.contenders)}
    others = list(result.contenders)[1:]
    height = 3.0 + (0.5 + len(COMPARED) * (0.12 + 0.13 * len(others)) if others else 0)
    words = f"{len(result)} scenarios of “{result.ensemble.name}”, seed {result.seed}, the same for all"
    with house_style():
        figure = new_figure(height, "Controllers in the same scenarios", words)
        if others:
            grid = figure.add_gridspec(2, 2, height_ratios=(2.2, height - 3.0))
            _ratios(figure.add_subplot(grid[1, :]), result, others, colours)
        else:
            grid = figure.add_gridspec(1, 2)
        for place, (metric, axis, factor) in enumerate(PANELS):
            axes = figure.add_subplot(grid[0, place])
            _shares(axes, result, metric, factor, colours)
            axes.set_xlabel(axis)
            axes.set_ylabel("" if place else "share of scenarios")
        legend_below(figure, [Line2D([], [], color=colours[name], label=name) for name in colours])
    return figure


def _shares(axes: Axes, result: Comparison, metric: str, factor: float, colours: dict[str, str]) -> None:
    for name, one in result.contenders.items():
        values = np.sort(factor * one.metrics[metric][one.completed])
        if len(values):
            axes.step(values, np.arange(1, len(values) + 1) / len(values), where="post", color=colours[name])
    _logarithmic(axes)
    axes.set_ylim(0, 1)
    axes.set_title(metric.upper() if metric == "mse" else metric)


def _ratios(axes: Axes, result: Comparison, others: list[str], colours: dict[str, str]) -> None:
    first = next(iter(result.contenders))
    for place, name in enumerate(others):
        offset = 0.6 * (place + 0.5) / len(others) - 0.3
        for row, pair in enumerate(result.paired(name).values()):
            ratio = pair.ratio_of_means
            axes.plot((ratio.low, ratio.high), (row + offset,) * 2, color=colours[name], linewidth=2.2, alpha=0.55)
            axes.plot(ratio.estimate, row + offset, "o", color=colours[name], markersize=4)
    axes.axvline(1, color=GREY, linewidth=0.8, zorder=1)
    _logarithmic(axes)
    axes.set_yticks(range(len(COMPARED)), [name.replace("_", " ") for name in COMPARED])
    axes.set_ylim(len(COMPARED) - 0.5, -0.5)
    axes.set_xlabel(f"over {first}; smaller is better")
    axes.set_title(f"ratio of means with {100 * CONFIDENCE:g} % interval")


def _logarithmic(axes: Axes) -> None:
    """A logarithmic axis with plain numbers, those between powers of ten too where it is short."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < FEW_DECADES * low else (1,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
