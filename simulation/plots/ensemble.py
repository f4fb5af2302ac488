"""An ensemble at a glance: how far the error and the tensions spread over the scenarios."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces
from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.ropes import KILO, draw_limits, limit_handle
from dualwinch.simulation.plots.style import (
    GREY,
    INK,
    house_style,
    law_colour,
    law_label,
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
