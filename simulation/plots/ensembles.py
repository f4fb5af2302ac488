"""Figures of scenarios: the fan chart of an ensemble, and controllers compared in the same scenarios."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.comparison import COMPARED, CONFIDENCE, Comparison
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.runs import KILO, draw_limits, length_unit, limit_handle
from dualwinch.simulation.plots.style import (
    BLUE,
    DASHES,
    GOLD,
    GREEN,
    GREY,
    INK,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    house_style,
    law_colour,
    law_label,
    logarithmic,
    plain,
    shade,
    steady_handle,
)

BANDS = ((0.05, 0.95, 0.28), (0.25, 0.75, 0.5))
"""Lower and upper share of a band, and how dark it is."""

ALL_SHADE = 0.12
"""How dark the band from the smallest to the largest value is."""


ASIDE = {"loc": "right", "fontsize": 7.5, "color": GREY}
"""Style of what is said in words beside a panel's name."""


def fan_chart(result: EnsembleResult, *, ax: GivenAxes = None) -> Figure:
    """Error and rope tensions over time: median, the middle 50 % and 90 % of the scenarios, and all of them.

    Args:
        result: of an ensemble, with traces.
        ax: axes for the error and for the tensions of rope 1 and rope 2; default: a figure of its own.

    Raises:
        ConfigurationError: no traces were kept, or no scenario ran to its end.
    """
    traces = result.traces
    if traces is None:
        raise ConfigurationError("a fan chart needs traces of scenarios that ran to their end: there are none")
    experiment = result.ensemble.experiment
    colour = law_colour(experiment)
    draw = (_error, partial(_tension, rope=1), partial(_tension, rope=2))
    with house_style():
        page = Page(ax, 6.4, *_headings(result))
        panels = page.panels(3, sharex=True, height_ratios=(1.45, 1, 1))
        for axes, panel in zip(panels, draw, strict=False):
            shade(axes, experiment)
            panel(axes, result, traces, colour=colour)
        page.time_axes(panels, experiment)
        page.align()
        page.legend([*_handles(colour), limit_handle(experiment), steady_handle()])
    return page.figure


def _headings(result: EnsembleResult) -> tuple[str, str]:
    ensemble, counts = result.ensemble, result.outcome_counts
    completed = counts.get("completed", 0)
    others = [f"{count} {outcome.replace('_', ' ')}" for outcome, count in counts.items() if outcome != "completed"]
    title = f"{plain(law_label(ensemble.experiment))} in the ensemble “{plain(ensemble.name)}”"
    words = f"{completed} scenarios, seed {result.seed}"
    return title, words + (f"; not drawn: {', '.join(others)}" if others else "; every one ran to its end")


def _error(axes: Axes, result: EnsembleResult, traces: Traces, colour: str) -> None:
    unit, name = length_unit(result.statistic("worst.max_abs_error"))
    _fan(axes, traces, "e", unit, colour)
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    axes.set_ylabel(rf"error $e = x - x_\mathrm{{ref}}$ ({name})")
    axes.set_title("tracking error")
    rms = np.sqrt(result.statistic("mean.mse"))
    median, most, worst = (result.statistic(f"{kind}.max_abs_error") / unit for kind in ("median", "p95", "worst"))
    words = f"RMS {rms / unit:.3g} {name} · largest |e|: median {median:.3g}, "
    axes.set_title(words + f"95 % {most:.3g}, worst {worst:.3g} {name}", **ASIDE)


def _tension(axes: Axes, result: EnsembleResult, traces: Traces, colour: str, rope: int) -> None:
    column = f"F{rope}"
    _fan(axes, traces, column, KILO, colour)
    draw_limits(axes, result.ensemble.experiment)
    axes.set_ylabel(f"tension $F_{rope}$ (kN)")
    axes.set_title(f"rope {rope}")
    if rope == 1:
        median, highest = (result.statistic(f"{kind}.peak_tension") / KILO for kind in ("median", "worst"))
        mean, longest = (100 * result.statistic(f"{kind}.slack_share") for kind in ("mean", "worst"))
        words = f"both ropes: peak median {median:.3g}, worst {highest:.3g} kN"
        words += f" · slack in {mean:.2g} % of the time, worst {longest:.2g} %"
        axes.set_title(words, **ASIDE)


def _fan(axes: Axes, traces: Traces, column: str, unit: float, colour: str) -> None:
    t = traces.t
    lowest, highest = traces.lowest[column] / unit, traces.highest[column] / unit
    axes.fill_between(t, lowest, highest, color=colour, alpha=ALL_SHADE, linewidth=0)
    for low, high, darkness in BANDS:
        below, above = traces.quantiles(column, (low, high)) / unit
        axes.fill_between(t, below, above, color=colour, alpha=darkness, linewidth=0)
    (median,) = traces.quantiles(column, (0.5,)) / unit
    axes.plot(t, median, color=INK, linewidth=0.9)


def _handles(colour: str) -> list[Line2D | Patch]:
    def patch(alpha: float, words: str) -> Patch:
        return Patch(facecolor=colour, alpha=alpha, linewidth=0, label=words)

    return [
        Line2D([], [], color=INK, linewidth=0.9, label="median"),
        patch(0.68, "50 %"),
        patch(0.37, "90 %"),
        patch(ALL_SHADE, "all scenarios"),
    ]


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
