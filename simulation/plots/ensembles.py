"""Figures of many runs: an ensemble's fan chart, controllers in the same scenarios, sweeps over keys."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.quantity import Quantity, unknown
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.simulation.ensembles.comparison import COMPARED, CONFIDENCE, Comparison
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces
from dualwinch.simulation.metrics.metrics import in_words, metric_quantities
from dualwinch.simulation.plots.page import STEADY_PATCH, GivenAxes, new_page, scenario
from dualwinch.simulation.plots.runs import KILO, draw_limits, length_unit
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    LIGHT,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    aside,
    law_label,
    law_look,
    logarithmic,
    looks,
    plain,
    zero_line,
)
from dualwinch.simulation.plots.traces import Floats
from dualwinch.simulation.sweep import Sweep

BANDS = ((0.05, 0.95, 0.28), (0.25, 0.75, 0.5))
"""Lower and upper quantile of a band, and its opacity."""

ALL_SHADE = 0.12
"""Opacity of the band from the smallest to the largest value."""


SEEN = {"50 %": 0.68, "90 %": 0.37, "all scenarios": ALL_SHADE}
"""Apparent opacity of the overlapping bands, for the legend."""


def fan_chart(result: EnsembleResult, *, ax: GivenAxes = None) -> Figure:
    """Error and rope tensions over time: median, central 50 % and 90 %, and range of all scenarios.

    Panels: the error, and the tensions of rope 1 and rope 2.

    Raises:
        ConfigurationError: no traces were kept, or no scenario completed.
    """
    if result.traces is None:
        raise ConfigurationError("a fan chart needs traces of scenarios that ran to their end: there are none")
    experiment = result.ensemble.experiment
    colour, _ = law_look(experiment)
    with new_page(ax, 6.4, *_headings(result)) as page:
        error, *ropes = panels = page.panels(3, sharex=True, height_ratios=(1.45, 1, 1))
        unit, name = length_unit(result.statistic("worst.max_abs_error"))
        _fan(error, result.traces, "e", unit, colour)
        zero_line(error)
        error.set(ylabel=rf"error $e = x - x_\mathrm{{ref}}$ ({name})", title="tracking error")
        rms = np.sqrt(result.statistic("mean.mse")) / unit
        median, most, worst = (result.statistic(f"{kind}.max_abs_error") / unit for kind in ("median", "p95", "worst"))
        words = f"RMS {rms:.3g} {name} · largest |e|: median {median:.3g}, 95 % {most:.3g}, worst {worst:.3g} {name}"
        aside(error, words)
        for rope, axes in enumerate(ropes, start=1):
            _fan(axes, result.traces, f"F{rope}", KILO, colour)
            draw_limits(axes, experiment)
            axes.set(ylabel=f"tension $F_{rope}$ (kN)", title=f"rope {rope}")
        median, highest = (result.statistic(f"{kind}.peak_tension") / KILO for kind in ("median", "worst"))
        mean, longest = (100 * result.statistic(f"{kind}.slack_share") for kind in ("mean", "worst"))
        words = f"both ropes: peak median {median:.3g}, worst {highest:.3g} kN"
        aside(ropes[0], words + f" · slack in {mean:.2g} % of the time, worst {longest:.2g} %")
        page.time_axes(panels, experiment)
        page.legend(STEADY_PATCH)
    return page.figure


def _headings(result: EnsembleResult) -> tuple[str, str]:
    counts = result.outcome_counts
    others = [f"{count} {outcome.replace('_', ' ')}" for outcome, count in counts.items() if outcome != "completed"]
    title = f"{plain(law_label(result.ensemble.experiment))} in the ensemble “{plain(result.ensemble.name)}”"
    words = f"{counts.get('completed', 0)} scenarios, seed {result.seed}"
    return title, words + (f"; not drawn: {', '.join(others)}" if others else "; every one ran to its end")


def _fan(axes: Axes, traces: Traces, column: str, unit: float, colour: str) -> None:
    def band(low: NDArray[Any], high: NDArray[Any], alpha: float) -> None:
        axes.fill_between(traces.t, low / unit, high / unit, color=colour, alpha=alpha, linewidth=0)

    (median,) = traces.quantiles(column, (0.5,)) / unit
    axes.plot(traces.t, median, color=INK, linewidth=0.9, label="median")
    for label, alpha in SEEN.items():
        axes.fill_between([], [], color=colour, alpha=alpha, linewidth=0, label=label)
    band(traces.lowest[column], traces.highest[column], ALL_SHADE)
    for low, high, darkness in BANDS:
        below, above = traces.quantiles(column, (low, high))
        band(below, above, darkness)


CONTROLLER_COLOURS = (GREY, BLUE, VERMILION, GREEN, PURPLE, GOLD, WINE, SKY)
"""Colours of controllers, the baseline first; reused with other dashes."""

PANELS = ("mse", "chatter")
"""Figures of merit whose distributions over the scenarios are shown."""


def comparison(result: Comparison, *, ax: GivenAxes = None) -> Figure:
    """Cumulative distributions of error and chatter, and ratios to the first controller with confidence intervals.

    Panels: error, chatter, ratios.
    """
    styles = looks(result.contenders, CONTROLLER_COLOURS)
    others = list(result.contenders)[1:]
    ratios_height = 0.5 + len(COMPARED) * (0.12 + 0.13 * len(others)) if others else 0.0
    words = f"{len(result)} scenarios of “{plain(result.ensemble.name)}”, seed {result.seed}, the same for all"
    rows, layout = [[*PANELS]], {}
    if others:
        rows, layout = [[*PANELS], ["ratios"] * len(PANELS)], {"height_ratios": (2.2, ratios_height)}
    with new_page(ax, 3.0 + ratios_height, "Controllers in the same scenarios", words) as page:
        panels = page.mosaic(rows, **layout)
        for axes, metric in zip(panels, PANELS, strict=False):
            quantity = metric_quantities()[metric]
            for name, contender in result.contenders.items():
                values = np.sort(quantity.scale * contender.of_completed(metric))
                shares = np.arange(1, len(values) + 1) / len(values)
                axes.step(values, shares, where="post", **styles[name], label=plain(name))
            logarithmic(axes, (1, 2, 5))
            axes.set(ylim=(0, 1), title=in_words(metric), xlabel=quantity.axis)
        panels[0].set_ylabel("share of scenarios")
        for axes in panels[len(PANELS) :]:
            _ratios(axes, result, styles)
        page.legend()
    return page.figure


def _ratios(axes: Axes, result: Comparison, styles: Mapping[str, dict[str, Any]]) -> None:
    first, *others = result.contenders
    for index, name in enumerate(others):
        offset, colour = 0.6 * (index + 0.5) / len(others) - 0.3, styles[name]["color"]
        for row, pair in enumerate(result.paired(name).values()):
            ratio = pair.ratio_of_means
            axes.plot((ratio.low, ratio.high), (row + offset,) * 2, color=colour, linewidth=2.2, alpha=0.55)
            axes.plot(ratio.estimate, row + offset, "o", color=colour, markersize=4)
    axes.axvline(1, color=GREY, linewidth=0.8, zorder=1)
    logarithmic(axes, (1, 2, 5))
    axes.set_yticks(range(len(COMPARED)), [name.replace("_", " ") for name in COMPARED])
    axes.set(
        ylim=(len(COMPARED) - 0.5, -0.5),
        xlabel=f"over {plain(first)}; smaller is better",
        title=f"ratio of means with {100 * CONFIDENCE:g} % interval",
    )


SPAN = 10
"""Ratio of the largest to the smallest number below which the axis is linear."""

LABELLED = 9
"""Maximum number of values that each get a tick."""


@dataclass(frozen=True)
class SweptAxis:
    """Axis of a swept key.

    Attributes:
        order: indices of the values along the axis.
        positions: (n,) positions of the values in that order.
        words: tick label of each value; empty for a numeric axis.
        log: whether the axis is logarithmic.
        categorical: whether the values are categories.
    """

    order: NDArray[np.int64]
    positions: Floats
    words: tuple[str, ...]
    log: bool
    categorical: bool = False

    @property
    def edges(self) -> Floats:
        """(n + 1,) edges of the cells around the values."""
        at = np.log(self.positions) if self.log else self.positions
        if len(at) == 1:
            half = 0.5 * (abs(at[0]) or 1.0)
            inner, first, last = np.empty(0), at[0] - half, at[0] + half
        else:
            inner = (at[1:] + at[:-1]) / 2
            first, last = 2 * at[0] - inner[0], 2 * at[-1] - inner[-1]
        edges = np.concatenate(([first], inner, [last]))
        return np.exp(edges) if self.log else edges

    def draw(self, axes: Axes, side: Literal["x", "y"], label: str) -> None:
        """Set scale, ticks and label of one of a panel's axes."""
        axes.set(**{f"{side}label": label} | ({f"{side}scale": "log"} if self.log else {}))
        axis = axes.xaxis if side == "x" else axes.yaxis
        if self.words:
            axis.set_ticks(self.positions.tolist(), self.words)
            axis.set_minor_locator(NullLocator())


def swept_axis(values: Sequence[Any]) -> SweptAxis:
    """The axis of a key's values."""
    if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        words = tuple("–" if value is None else str(value).lower() for value in values)
        order = np.arange(len(values))
        return SweptAxis(order, order.astype(float), words, log=False, categorical=True)
    order = np.argsort(values)
    positions = np.array(values, float)[order]
    words = tuple(f"{value:.4g}" for value in positions) if len(positions) <= LABELLED else ()
    return SweptAxis(order, positions, words, log=grows_by_factors(positions))


def grows_by_factors(ascending: Floats) -> bool:
    """Whether the ratios between successive numbers are more even than the differences."""
    if len(ascending) < 3 or ascending[0] <= 0 or ascending[-1] < SPAN * ascending[0]:
        return False
    factors, differences = np.diff(np.log(ascending)), np.diff(ascending)
    return bool(np.ptp(factors) / factors.mean() < np.ptp(differences) / differences.mean())


def spans_decades(values: Floats) -> bool:
    """Whether values, possibly with NaN, span so many decades that only a logarithmic scale shows them."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() >= 3 * SPAN * finite.min())


MARKS = {"diverged": "x", "left_track": ">", "not_run": "."}
"""Outcome of an incomplete run → marker."""

WRITTEN = 60
"""Maximum number of cells with their values written in them."""


def sweep_figure(found: Sweep, metric: str, *, ax: GivenAxes = None) -> Figure:
    """Draw a sweep; see `Sweep.plot`.

    Raises:
        UnknownNameError: an unknown figure of merit.
        ConfigurationError: more than two keys, or none.
    """
    if metric not in found.metrics:
        raise UnknownNameError(unknown("metric", metric, found.metrics))
    if len(found.keys) not in {1, 2}:
        raise ConfigurationError(f"a sweep of {len(found.keys)} keys cannot be drawn; at(key, value) removes one")
    along = [swept_axis(values) for values in found.values]
    values, outcomes = found.metrics[metric], found.outcomes
    for dimension, axis in enumerate(along):
        values, outcomes = values.take(axis.order, dimension), outcomes.take(axis.order, dimension)
    title = f"{metric} over {' and '.join(key.rsplit('.', 1)[-1] for key in found.keys)}"
    law = "" if "controller.kind" in found.keys else f"{law_label(found.experiment)}; "
    with new_page(ax, 2.6 + 0.6 * len(along), title, law + scenario(found.experiment)) as page:
        (axes,) = page.panels()
        draw = _line if len(along) == 1 else _map
        draw(axes, along, values, _named(metric, found.merits[metric]))
        for outcome, marker in MARKS.items():
            ended = np.nonzero(outcomes == outcome)
            x, *y = (axis.positions[indices] for axis, indices in zip(along, ended, strict=True))
            below = (np.full(len(x), 0.04), axes.get_xaxis_transform())
            y, transform = (y[0], axes.transData) if y else below
            label = outcome.replace("_", " ") if len(x) else None
            marked = {"marker": marker, "linestyle": "none", "color": VERMILION, "label": label}
            axes.plot(x, y, **marked, transform=transform, clip_on=len(along) > 1)
        axes.set_title(readable(found.merits[metric].meaning))
        for key, axis, side in zip(found.keys, along, ("x", "y"), strict=False):
            axis.draw(axes, side, _named(key, found.quantities[key]))
        page.legend()
    return page.figure


def _line(axes: Axes, along: list[SweptAxis], values: Floats, name: str) -> None:
    (axis,) = along
    line = "none" if axis.categorical else "-"
    axes.plot(axis.positions, values, marker="o", markersize=4, linestyle=line, color=BLUE)
    axes.set(ylabel=name, yscale="log" if spans_decades(values) else "linear")
    if axis.categorical:
        axes.set_xlim(-0.5, len(axis.positions) - 0.5)


def _map(axes: Axes, along: list[SweptAxis], values: Floats, name: str) -> None:
    across, up = along
    axes.grid(visible=False)
    axes.set(facecolor=LIGHT, xlim=across.edges[[0, -1]], ylim=up.edges[[0, -1]])
    if not np.isfinite(values).any():
        return
    scale = (LogNorm if spans_decades(values) else Normalize)(np.nanmin(values), np.nanmax(values))
    cells = axes.pcolormesh(across.edges, up.edges, values.T, norm=scale, cmap="viridis")
    bar = axes.figure.colorbar(cells, ax=axes, label=name)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]  # the stub has no Spine here
    if values.size <= WRITTEN:
        for i, j in zip(*np.nonzero(np.isfinite(values)), strict=True):
            colour = "white" if scale(values[i, j]) < 0.6 else INK
            centred = {"ha": "center", "va": "center", "color": colour, "size": 7}
            axes.text(float(across.positions[i]), float(up.positions[j]), f"{values[i, j]:.3g}", **centred)


def _named(words: str, quantity: Quantity) -> str:
    unit = readable_unit(quantity.unit)
    return f"{words} ({unit})" if unit else words
