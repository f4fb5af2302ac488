"""Controllers in the same scenarios at a glance: how their errors and chatter spread, and the ratios of their means."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.simulation.ensembles.comparison import COMPARED, CONFIDENCE, Comparison
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import (
    BLUE,
    DASHES,
    GOLD,
    GREEN,
    GREY,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    house_style,
    logarithmic,
    plain,
)

COLOURS = (GREY, BLUE, VERMILION, GREEN, PURPLE, GOLD, WINE, SKY)
"""A colour for each controller, the first being what the others are compared with; then again, with other dashes."""

PANELS = ("mse", "chatter")
"""Figures of merit of the panels that show the scenarios."""


def comparison(result: Comparison, *, ax: GivenAxes = None) -> Figure:
    """Shares of scenarios up to an error and a chatter, and ratios to the first controller with their intervals.

    Args:
        result: of controllers in the same scenarios.
        ax: axes for error, chatter and ratios; default: a figure of its own.
    """
    looks = _looks(list(result.contenders))
    others = list(result.contenders)[1:]
    height = 3.0 + (0.5 + len(COMPARED) * (0.12 + 0.13 * len(others)) if others else 0)
    words = f"{len(result)} scenarios of “{plain(result.ensemble.name)}”, seed {result.seed}, the same for all"
    draw: list[Callable[..., None]] = [partial(_shares, metric=metric) for metric in PANELS]
    top, layout = [*PANELS], {}
    if others:
        draw.append(_ratios)
        layout = {"height_ratios": (2.2, height - 3.0)}
    with house_style():
        page = Page(ax, height, "Controllers in the same scenarios", words)
        panels = page.mosaic([top, *([["ratios"] * 2] if others else [])], **layout)
        for axes, panel in zip(panels, draw, strict=False):
            panel(axes, result, looks)
        panels[0].set_ylabel("share of scenarios")
        page.legend([Line2D([], [], **look, label=plain(name)) for name, look in looks.items()])
    return page.figure


def _looks(names: list[str]) -> dict[str, dict[str, Any]]:
    """Colour and line style of every controller."""
    return {
        name: {
            "color": COLOURS[index % len(COLOURS)],
            "linestyle": DASHES[index // len(COLOURS) % len(DASHES)],
        }
        for index, name in enumerate(names)
    }


def _shares(axes: Axes, result: Comparison, looks: Mapping[str, dict[str, Any]], *, metric: str) -> None:
    quantity = metric_quantities()[metric]
    for name, contender in result.contenders.items():
        values = np.sort(quantity.scale * contender.metrics[metric][contender.completed])
        if len(values):
            axes.step(values, np.arange(1, len(values) + 1) / len(values), where="post", **looks[name])
    logarithmic(axes, (1, 2, 5))
    axes.set_ylim(0, 1)
    axes.set_title(metric.upper() if metric == "mse" else metric)
    axes.set_xlabel(quantity.axis)


def _ratios(axes: Axes, result: Comparison, looks: Mapping[str, dict[str, Any]]) -> None:
    first, *others = result.contenders
    for index, name in enumerate(others):
        offset, colour = 0.6 * (index + 0.5) / len(others) - 0.3, looks[name]["color"]
        for row, pair in enumerate(result.paired(name).values()):
            ratio = pair.ratio_of_means
            axes.plot((ratio.low, ratio.high), (row + offset,) * 2, color=colour, linewidth=2.2, alpha=0.55)
            axes.plot(ratio.estimate, row + offset, "o", color=colour, markersize=4)
    axes.axvline(1, color=GREY, linewidth=0.8, zorder=1)
    logarithmic(axes, (1, 2, 5))
    axes.set_yticks(range(len(COMPARED)), [name.replace("_", " ") for name in COMPARED])
    axes.set_ylim(len(COMPARED) - 0.5, -0.5)
    axes.set_xlabel(f"over {first}; smaller is better")
    axes.set_title(f"ratio of means with {100 * CONFIDENCE:g} % interval")
