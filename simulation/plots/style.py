"""The house style of every figure: colours, line styles, sizes, units, axes.

Matplotlib is loaded when the first figure is drawn.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from typing import TYPE_CHECKING, Any, TypeAlias

from dualwinch.codegen.text import one_line
from dualwinch.simulation.experiment import Experiment

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import LineStyleType

BLUE, VERMILION, GREEN, GOLD, WINE = "#0072B2", "#D55E00", "#009E73", "#A87900", "#882255"
PURPLE, SKY = "#CC79A7", "#56B4E9"
INK, GREY, LIGHT, SHADE = "#1A1A1A", "#6B6B6B", "#D9D9D9", "#F0F0F0"

Look: TypeAlias = "tuple[str, LineStyleType]"
"""Colour and line style."""

PALETTE = (GOLD, WINE, GREY, PURPLE, SKY, GREEN, VERMILION, BLUE)
"""Colours of runs whose law's colour is already used; colours that belong to no law come first."""

DASHES: "tuple[LineStyleType, ...]" = (
    "-",
    (0, (5, 2)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (2, 1.5)),
)
"""Line styles of runs, so that coinciding lines are both visible, also in print."""

ROPE_COLOURS = (WINE, GOLD)
"""Rope 1 and rope 2, where one panel shows both."""

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
    "axes.prop_cycle": f"cycler(color={[BLUE, VERMILION, GREEN, GOLD, WINE]})",
    "axes.formatter.useoffset": False,
    "axes.formatter.min_exponent": 3,  # logarithmic axes show 6, not 6 x 10^0
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
    "savefig.dpi": 200,
    "svg.hashsalt": "dualwinch",
    "svg.fonttype": "path",
}
"""Matplotlib settings, applied only while a figure is drawn and written."""


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's defaults with `STYLE`, regardless of the user's settings."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        settings: Any = mpl.rcParams
        settings.update(STYLE)
        yield


def plain(text: str) -> str:
    r"""A user's name escaped for Matplotlib: ``$`` starts no formula, a leading ``_`` does not hide a label."""
    escaped = one_line(text).replace("$", r"\$")
    return f"\u200b{escaped}" if escaped.startswith("_") else escaped


def law_label(experiment: Experiment) -> str:
    """Name of an experiment's position law in figures."""
    law = experiment.controller.law
    return law.label or law.kind


def law_look(experiment: Experiment) -> Look:
    """Colour and line style of an experiment's position law."""
    law = experiment.controller.law
    return law.colour or BLUE, law.dashes or "-"


def looks(names: Iterable[str], colours: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Name → colour and line style: the colours in order, then again with other dashes."""
    styles = ({"color": colour, "linestyle": dashes} for dashes in DASHES for colour in colours)
    return dict(zip(names, cycle(styles), strict=False))


def aside(axes: "Axes", words: str) -> None:
    """Write a small remark above a panel, on the right."""
    axes.set_title(words, loc="right", fontsize=7.5, color=GREY)


def zero_line(axes: "Axes") -> None:
    """Draw a thin line at zero, behind the signals."""
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)


FEW_DECADES = 300
"""Ratio of an axis's ends up to which numbers between powers of ten fit."""


def logarithmic(axes: "Axes", between: tuple[int, ...]) -> None:
    """Make the x axis logarithmic with plain numbers at powers of ten and, if it is short, multiples `between` them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=between if high < FEW_DECADES * low else (1,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))
"""Factors of the SI and their prefixes, the largest first."""


def prefixed_unit(unit: str, *values: float) -> tuple[float, str]:
    """Size and name of the unit with the largest SI prefix at which the largest of the values is at least 1.

    Values are magnitudes in the `unit` without a prefix, NaN where there is none.

    Example:
        >>> prefixed_unit("N", 300.0, 89.2), prefixed_unit("m", 0.018)
        ((1.0, 'N'), (0.001, 'mm'))
    """
    largest = max((value for value in values if value > 0), default=0.0)
    size, prefix = next((entry for entry in PREFIXES if largest >= entry[0]), PREFIXES[-1])
    return size, prefix + unit


def tension_unit(experiment: Experiment, *tensions: float) -> tuple[float, str]:
    """Size in N and name of the unit of an axis that shows tensions and the limits of their commands."""
    return prefixed_unit("N", experiment.controller.limits.tension_max, *tensions)


LIMIT = {"color": INK, "linestyle": (0, (2, 2)), "linewidth": 0.8, "zorder": 1.5}
"""Line style of a limit."""


def draw_limits(axes: "Axes", experiment: Experiment, unit: tuple[float, str], *, label: str | None = "limits") -> None:
    """Draw the limits of the tension commands in a unit (`tension_unit`); `label` begins their legend entry."""
    limits, (size, name) = experiment.controller.limits, unit
    low, high = limits.tension_min / size, limits.tension_max / size
    axes.axhline(low, **LIMIT, label=label and f"{label} {low:g} and {high:g} {name}")
    axes.axhline(high, **LIMIT)
