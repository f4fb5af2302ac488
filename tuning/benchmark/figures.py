"""A race: errors over those of the paper's gains, a row an entry; and what less chatter and less load cost in error."""

import math
from collections.abc import Iterable
from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.plots.page import GivenAxes, Page
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
    logarithmic,
    plain,
)
from dualwinch.tuning.benchmark.found import MEAN_ERROR, BenchmarkFindings
from dualwinch.tuning.benchmark.scores import COSTS, EntryResult, ScoredRuns, undominated
from dualwinch.tuning.benchmark.summary import spaced

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, GOLD, WINE, SKY)
"""Of the entries, the best first; then again, with other dashes."""

ROOM = 1.6
"""Factor by which the axis goes on on the right, for words."""

CLUSTER = 6.0
"""Factor by which a search may be off the one before for the number to stand behind it, and not between them."""

HEADING, A_ROW = 1.45, 0.27
"""Heights in inches."""

AXES = {"chatter": "mean chatter (N)", "continuous_load": "mean continuous load (N m)"}
"""Figure of merit → name of its axis."""

WIDE = frozenset({"chatter"})
"""Figures of merit that differ by factors."""

MILLIMETRES = 1e3

SMALL = 0.1
"""Ratios below that are written as fractions."""

NEAR = 0.05
"""A least error is drawn where it is no smaller than this share of the least error of all."""


def race_figure(found: BenchmarkFindings, *, ax: GivenAxes = None) -> Figure:
    """Draw ratios of errors; see `Race.plot`."""
    terms = found.terms
    words = (
        f"{terms.rollouts} rollouts in “{plain(terms.ensemble)}” to tune each, "
        f"scored in {terms.held_out} scenarios that nobody has seen"
    )
    with house_style():
        page = Page(ax, HEADING + A_ROW * max(len(found.ranking), 3), "Tuned alike: who tracks best?", words)
        (axes,) = page.panels(1)
        first = found.ranking[0].entry.key if found.entries else ""
        tied = {first, *found.alike(first)} if first else set()
        for row, scored in enumerate(found.ranking):
            _dot(axes, found, scored, row, BLUE if scored.entry.key in tied else INK)
        axes.axvline(1, color=VERMILION, linewidth=1.0, zorder=1)
        logarithmic(axes, (1, 2, 3, 5))
        axes.set_yticks(range(len(found.ranking)), [plain(found.names[each.entry.key]) for each in found.ranking])
        axes.set_ylim(len(found.ranking) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        low, high = axes.get_xlim()
        axes.set_xlim(low, ROOM * high)
        axes.set_xlabel("mean square error over that of the paper's gains, with 95 % interval; less is better")
        dot = partial(Line2D, [], [], marker="o", markersize=5, linestyle="none")
        handles = [
            dot(color=BLUE, label="best, or not different from it"),
            dot(color=INK, label="other"),
            dot(color=INK, markerfacecolor="white", label="breaks a constraint"),
            Line2D([], [], color=VERMILION, label="the paper's gains"),
        ]
        if len(found.entries) > len(found.ranking):
            handles.insert(3, dot(color=INK, marker="|", markersize=8, label="its searches"))
        page.legend(handles)
    return page.figure


def _dot(axes: Axes, found: BenchmarkFindings, scored: EntryResult, row: int, colour: str) -> None:
    interval = found.ratios[scored.entry.key].interval
    if math.isnan(interval.estimate):
        return
    face = "white" if scored.runs.broken else colour
    axes.plot((interval.low, interval.high), (row, row), color=colour, linewidth=2.0, alpha=0.5)
    axes.plot(interval.estimate, row, "o", color=colour, markerfacecolor=face, markersize=5, zorder=3)
    others = [found.ratios[search.entry.key].interval.estimate for search in found.searches[scored.entry.group]]
    if len(others) > 1:
        axes.plot(others, [row] * len(others), "|", color=colour, markersize=8)
    axes.annotate(
        _share(interval.estimate),
        (end_of_marks(interval.high, others), row),
        xytext=(5, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=7,
        color=colour,
        annotation_clip=False,
    )


def end_of_marks(high: float, others: Iterable[float]) -> float:
    """Where the marks end that lie together with an interval; searches that are far off stand alone."""
    for other in sorted(others):
        if high < other < CLUSTER * high:
            high = other
    return high


def _share(ratio: float) -> str:
    """A ratio as it is best read: ``6.4×``, or ``1/16 000``."""
    return f"{ratio:.2g}×" if ratio >= SMALL else f"1/{spaced(float(f'{1 / ratio:.2g}'))}"


def fronts_figure(found: BenchmarkFindings, *, ax: GivenAxes = None) -> Figure:
    """Draw what is traded; see `Race.plot_fronts`."""
    looks = {
        scored.entry.key: {
            "color": COLOURS[rank % len(COLOURS)],
            "linestyle": DASHES[rank // len(COLOURS) % len(DASHES)],
        }
        for rank, scored in enumerate(found.ranking)
    }
    words = (
        f"Trials that keep to every constraint, in {found.terms.held_out} unseen scenarios; ●: the best, ×: the paper's"
    )
    with house_style():
        page = Page(ax, 3.4 + 0.1 * len(looks), "What less chatter and less load cost", words)
        panels = page.panels(1, len(COSTS), "C", sharey=True)
        for axes, cost in zip(panels, COSTS, strict=False):
            for scored in found.ranking:
                _front(axes, scored, cost, looks[scored.entry.key])
            axes.plot(*_means(found.paper.runs, cost), "x", color=VERMILION, markersize=6)
            if cost in WIDE:
                logarithmic(axes, (1, 2, 3, 5))
            axes.set_xlabel(AXES[cost])
            _least(axes, found)
        panels[0].set_yscale("log")
        panels[0].yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panels[0].set_ylabel("RMS error (mm)")
        handles = [Line2D([], [], **look, label=plain(found.names[key])) for key, look in looks.items()]
        page.legend([*handles, *_least_handles(found)])
    return page.figure


def _front(axes: Axes, scored: EntryResult, cost: str, look: dict[str, Any]) -> None:
    kept = [point for point in scored.fronts.get(cost, ()) if point.kept]
    best = _means(scored.runs, cost)
    points = [(point.cost, _rms(point.error)) for point in kept] + ([] if scored.runs.broken else [best])
    if points:
        shown = [points[index] for index in undominated(*zip(*points, strict=True))]
        axes.plot(*zip(*shown, strict=True), linewidth=1.1, alpha=0.8, marker=".", markersize=3, **look)
    face = "white" if scored.runs.broken else look["color"]
    axes.plot(*best, "o", color=look["color"], markerfacecolor=face, markersize=4)


def _means(runs: ScoredRuns, cost: str) -> tuple[float, float]:
    return runs.over(Statistic("mean", cost)), _rms(runs.over(MEAN_ERROR))


def _rms(mean_square: float) -> float:
    """In mm, from m²."""
    return MILLIMETRES * math.sqrt(mean_square)


def _least_lines(found: BenchmarkFindings) -> Iterable[tuple[float, tuple[int, tuple[float, ...]], str]]:
    """Least errors in mm that are near those of the entries: value, dashes and name."""
    nearest = min((_rms(each.runs.over(MEAN_ERROR)) for each in found.entries if each.runs.completed.any()), default=0)
    lines = (
        (found.paper.least, (0, (4, 2)), "least error without foresight"),
        (found.paper.least_foreseeing, (0, (1, 1.5)), "with foresight"),
    )
    for values, dashes, name in lines:
        value = _rms(float(values.mean()))
        if value > NEAR * nearest:
            yield value, dashes, name


def _least(axes: Axes, found: BenchmarkFindings) -> None:
    for value, dashes, _ in _least_lines(found):
        axes.axhline(value, color=GREY, linestyle=dashes, linewidth=1.0)


def _least_handles(found: BenchmarkFindings) -> list[Line2D]:
    return [Line2D([], [], color=GREY, linestyle=dashes, label=name) for _, dashes, name in _least_lines(found)]
