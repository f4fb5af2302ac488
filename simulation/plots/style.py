"""The house style of every figure: colours, sizes, headings, legends."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.typing import LineStyleType

from dualwinch.codegen.text import one_line
from dualwinch.simulation.experiment import Experiment

WIDTH = 7.0
"""Width of every figure in inches: a page, or half a screen."""

BLUE, VERMILION, GREEN, GOLD, WINE = "#0072B2", "#D55E00", "#009E73", "#A87900", "#882255"
PURPLE, SKY = "#CC79A7", "#56B4E9"
INK, GREY, LIGHT, SHADE = "#1A1A1A", "#6B6B6B", "#D9D9D9", "#F0F0F0"

DASHES: tuple[LineStyleType, ...] = (
    "-",
    (0, (5, 2)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (2, 1.5)),
)
"""Line styles to tell runs apart, so that lines lying on each other are both seen, also in print."""

ROPE_COLOURS = (WINE, GOLD)
"""Rope 1 and rope 2, where one panel shows both."""

LEGEND_WIDTH, LEGEND_HANDLE = 105, 7
"""Characters a legend below a figure has room for, and those its line samples take."""

STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelsize": 8.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=[BLUE, VERMILION, GREEN, GOLD, WINE]),
    "axes.formatter.useoffset": False,
    "axes.formatter.min_exponent": 3,  # logarithmic axes say 6, not 6 x 10^0
    "grid.color": LIGHT,
    "grid.linewidth": 0.5,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "lines.linewidth": 1.2,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "text.color": INK,
    "figure.facecolor": "white",
    "figure.dpi": 100,
    "savefig.facecolor": "white",
    "svg.hashsalt": "dualwinch",
    "svg.fonttype": "path",
}
"""Matplotlib settings, applied while a figure is made and while it is written, never for the whole process."""


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's defaults with `STYLE`, whatever the user's own settings are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        settings: Any = mpl.rcParams
        settings.update(STYLE)
        yield


def new_figure(height: float, title: str, subtitle: str, gap: float = 0.05) -> Figure:
    """An empty figure with its heading; panels and legend are laid out without overlaps.

    Args:
        height: in inches.
        title: first line, bold.
        subtitle: second line.
        gap: half the vertical space between two panels, in inches.
    """
    engine = ConstrainedLayoutEngine(w_pad=0.06, h_pad=gap, hspace=0.04, wspace=0.03)
    figure = Figure(figsize=(WIDTH, height), layout=engine)
    left = 0.06 / WIDTH
    # the heading's room is reserved by an invisible suptitle of two lines, its text drawn over it in two weights
    figure.suptitle(" \n ", x=left, ha="left", fontsize=10, linespacing=1.35)
    figure.text(left, 1 - 0.06 / height, title, ha="left", va="top", fontsize=10.5, fontweight="bold")
    figure.text(left, 1 - 0.25 / height, subtitle, ha="left", va="top", fontsize=8.5, color=GREY)
    return figure


def law_kind(experiment: Experiment) -> str:
    """Name of an experiment's position law in configurations."""
    return experiment.controller.law.kind


def plain(text: str) -> str:
    r"""A user's name, for matplotlib: ``$`` begins no formula, a leading ``_`` leaves no label out."""
    shown = one_line(text).replace("$", r"\$")
    return f"\u200b{shown}" if shown.startswith("_") else shown


def law_label(experiment: Experiment) -> str:
    """Name of an experiment's position law in figures."""
    return experiment.controller.law.label or law_kind(experiment)


def law_colour(experiment: Experiment) -> str:
    """Colour of an experiment's position law."""
    return experiment.controller.law.colour or BLUE


def law_dashes(experiment: Experiment) -> LineStyleType:
    """Line style of an experiment's position law."""
    return experiment.controller.law.dashes or "-"


def legend_below(figure: Figure, handles: list[Line2D | Patch]) -> None:
    """One legend for all panels, below them, where it covers nothing."""
    widths = [len(str(handle.get_label())) + LEGEND_HANDLE for handle in handles]
    rows = -(-sum(widths) // LEGEND_WIDTH)
    columns = min(-(-len(handles) // rows), max(LEGEND_WIDTH // max(widths), 1))  # so many as wide as the widest fit
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, handlelength=2.6, columnspacing=1.6)


FEW_DECADES = 300
"""Ratio of an axis's ends up to which numbers between powers of ten have room."""


def logarithmic(axes: Axes, between: tuple[int, ...]) -> None:
    """A logarithmic x axis with plain numbers, at those multiples of powers of ten where it is short, else at these."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=between if high < FEW_DECADES * low else (1,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def steady_handle() -> Patch:
    """Legend entry of the shaded steady-state window."""
    return Patch(facecolor=SHADE, edgecolor=LIGHT, label="steady state")


def shade(axes: Axes, experiment: Experiment) -> None:
    """Shade the steady-state window on a time axis in s."""
    start, end = experiment.steady_window
    axes.axvspan(start, min(end, experiment.duration), color=SHADE, linewidth=0, zorder=0)


def time_axis(axes: Axes, experiment: Experiment, *, named: bool = True) -> None:
    """Limit an axis to the run's duration in s and name it."""
    axes.set_xlim(0, experiment.duration)
    if named:
        axes.set_xlabel("time (s)")
