"""What the observer is worth in the steady state: Figure 21."""

from collections.abc import Mapping, Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import REDUCTIONS, WITH_OBSERVER, WITHOUT_OBSERVER, percent, steady_change
from dualwinch.simulation.plots.curves import Curve, Runs, curves, ending
from dualwinch.simulation.plots.headings import case_number, scenario
from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import GREY, INK, house_style, law_kind

NAMES = {"mae": "mean |e|", "max_abs_error": "largest |e|", "mse": "mean e²"}
"""Figure of merit → its name on an axis."""

POWERS = {"mae": 1, "max_abs_error": 1, "mse": 2}
"""Figure of merit → its power of metres."""

PAPER_COLOUR = "#BDBDBD"

ROOM = 0.2
"""A change this large has room for its number inside its bar."""


def steady_state_bars(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Steady-state errors with and without the observer, and their change beside the paper's (Figure 21).

    Args:
        results: label → result, or results, of one case, the paper's Case 4; the first by `fando-nftsm` and the first
            by `nftsm` are compared.
        ax: axes for the three errors and for their changes; default: a figure of its own.

    Raises:
        ConfigurationError: one of the two is missing.
    """
    by_law: dict[str, Curve] = {}
    for run in curves(results):
        by_law.setdefault(law_kind(run.experiment), run)
    change = steady_change({kind: run.result for kind, run in by_law.items()})
    if change is None:
        raise ConfigurationError(f"Figure 21 compares {WITH_OBSERVER} with {WITHOUT_OBSERVER}: both are needed")
    pair = [by_law[kind] for kind in (WITHOUT_OBSERVER, WITH_OBSERVER)]
    experiment = pair[1].experiment
    start, end = experiment.steady_window
    number = case_number(experiment)
    title = "effect of the observer in the steady state"
    title = f"Figure 21 · Case {number}: {title}" if number == 4 else title[0].upper() + title[1:]
    subtitle = f"{scenario(experiment).capitalize()}; steady state from {start:g} to {end:g} s"
    draw = [partial(_errors, pair=pair, metric=metric) for metric in NAMES]
    draw.append(partial(_changes, change=change, colour=pair[1].colour))
    with house_style():
        page = Page(ax, 5.0, title, subtitle, gap=0.07)
        panels = page.mosaic([list(NAMES), ["change"] * 3], height_ratios=(1.25, 1))
        for axes, panel in zip(panels, draw, strict=False):
            panel(axes)
        handles = [Patch(facecolor=run.colour, label=f"{run.label}{ending(run.result)}") for run in pair]
        page.legend([*handles, Patch(facecolor=PAPER_COLOUR, label="the paper's reduction")])
    return page.figure


def _errors(axes: Axes, pair: Sequence[Curve], metric: str) -> None:
    values = [getattr(run.result.metrics, f"steady_{metric}") for run in pair]
    power = POWERS[metric]
    unit, name = length_unit(max(values) ** (1 / power))
    heights = [value / unit**power for value in values]
    bars = axes.bar(range(len(pair)), heights, width=0.62, color=[run.colour for run in pair])
    axes.bar_label(bars, [three_digits(height) for height in heights], padding=2, fontsize=8.5)
    axes.set_xticks([])
    axes.set_xlim(-0.6, len(pair) - 0.4)
    axes.margins(y=0.14)
    axes.grid(visible=False)
    axes.set_title(f"{NAMES[metric]} ({name}{'²' if power == 2 else ''})")
    axes.tick_params(left=False, labelleft=False)
    axes.spines["left"].set_visible(False)


def _changes(axes: Axes, change: Mapping[str, float], colour: str) -> None:
    for row, (metric, paper) in enumerate(REDUCTIONS.items()):
        for offset, value, its_colour in ((-0.19, change[metric], colour), (0.19, paper, PAPER_COLOUR)):
            measured = offset < 0
            axes.barh(row + offset, 100 * value, height=0.34, color=its_colour)
            room = value < -ROOM
            axes.annotate(
                percent(value) if measured else percent(value, "+g"),
                (100 * value if room else min(100 * value, 0.0), row + offset),
                xytext=(6 if room else -4, -0.5),
                textcoords="offset points",
                ha="left" if room else "right",
                va="center",
                fontweight="bold" if measured else "normal",
                color="white" if measured and room else INK,
            )
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.set_yticks(range(len(NAMES)), list(NAMES.values()))
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(-100, max(0.0, axes.get_xlim()[1]) if max(change.values()) > 0 else 0)
    axes.set_xticks(range(-100, 1, 25), [percent(tick / 100, "g") for tick in range(-100, 1, 25)])
    axes.set_title("change by the observer: measured, and in the paper")


def three_digits(value: float) -> str:
    """A number with three significant digits, trailing zeros kept, e.g. 6.40."""
    return f"{value:#.3g}".removesuffix(".")
