"""What breaks first: a row an imperfection, and the size at which gains break, over its size in the ensemble."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import BLUE, GREY, INK, VERMILION, house_style, plain
from dualwinch.tuning.robustness.found import Breakdown, ImperfectionResult, RobustnessFindings
from dualwinch.tuning.robustness.sizes import HIGHEST, LOWEST, STEPS, size

COLOURS = (VERMILION, BLUE)
"""Of the paper's gains, and of those beside them."""

ROOM = 15.0
"""Factor by which the axis goes on behind the largest size, for words."""

APART = 0.2
"""Half the distance of two gains in a row."""

HEADING, A_ROW = 1.35, 0.34
"""Heights in inches."""


def stress_figure(found: RobustnessFindings, *, ax: GivenAxes = None) -> Figure:
    """Draw a stress test; see `Stress.plot`."""
    looks = dict(zip(found.controllers, COLOURS if len(found.controllers) > 1 else COLOURS[1:], strict=False))
    scaling = found.scaling
    title = "What breaks first"
    words = (
        f"Imperfections of “{plain(scaling.ensemble.name)}” on top of “{plain(scaling.base.name)}”, "
        f"{scaling.count} scenarios, seed {scaling.seed}; the worst scenario counts"
    )
    with house_style():
        page = Page(ax, HEADING + A_ROW * max(len(found.rows), 3), title, words)
        (axes,) = page.panels(1)
        for height, row in enumerate(found.ranking):
            for index, name in enumerate(found.names):
                offset = APART * (2 * index / (len(found.names) - 1) - 1) if len(found.names) > 1 else 0.0
                _draw(axes, found, row, row.breaks[name], height + offset, looks[name])
        _scales(axes, found)
        handles = [
            Line2D([], [], color=colour, marker="o", markersize=5, linestyle="none", label=_legend(found, name))
            for name, colour in looks.items()
        ]
        page.legend([*handles, Line2D([], [], color=GREY, marker=">", markersize=5, label="holds", linestyle="none")])
    return page.figure


def _draw(
    axes: Axes, found: RobustnessFindings, row: ImperfectionResult, broken: Breakdown, height: float, colour: str
) -> None:
    """The sizes up to which gains hold, and the one at which they break with what broke, or an arrow."""
    lowest = size(LOWEST)
    end = broken.held if broken.size is None else broken.size
    axes.plot((lowest / 1.3, max(end, lowest)), (height, height), color=colour, linewidth=1.6, alpha=0.45)
    if broken.size is None:
        if broken.held:
            axes.plot(end, height, ">", color=colour, markersize=5)
        return
    axes.plot(end, height, "o", color=colour, markersize=5, zorder=3)
    amount = found.amount(row, broken.size)
    words = ", ".join(filter(None, (str(amount) if amount and not row.switched else "", broken.broken[0].label)))
    axes.annotate(
        words,
        (end, height),
        xytext=(6, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=7,
        color=colour,
        annotation_clip=False,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85},
    )


def _scales(axes: Axes, found: RobustnessFindings) -> None:
    name = plain(found.scaling.ensemble.name)
    axes.set_xscale("log")
    axes.set_xlim(size(LOWEST) / 1.3, size(HIGHEST) * ROOM)
    axes.xaxis.set_major_locator(FixedLocator([size(rung) for rung in range(LOWEST, HIGHEST + 1, STEPS)]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(f"size of the imperfection over its size in “{name}”")
    axes.axvline(1, color=INK, linewidth=0.9, zorder=1)
    labels = []
    for row in found.ranking:
        amount = found.amount(row, 1.0)
        labels.append(f"{row.imperfection.label}  {amount}" if amount else row.imperfection.label)
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def _legend(found: RobustnessFindings, name: str) -> str:
    """Name of gains, and whether they hold without any imperfection."""
    words = "the paper's gains" if name == "paper" else plain(name)
    return f"{words}: break without any" if found.lost[name] else f"{words} break"
