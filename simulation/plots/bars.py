"""What the observer is worth in the steady state: Figure 21."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.comparison import WITH_OBSERVER, WITHOUT_OBSERVER, percent, steady_change
from dualwinch.simulation.paper import REDUCTIONS
from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.style import (
    COLOURS,
    GREY,
    INK,
    LAW_NAMES,
    case_number,
    house_style,
    legend_below,
    new_figure,
    ordered,
    scenario,
)
from dualwinch.simulation.result import Result

NAMES = {"mae": "mean |e|", "max_abs_error": "largest |e|", "mse": "mean e²"}
"""Figure of merit → its name on an axis."""

POWERS = {"mae": 1, "max_abs_error": 1, "mse": 2}
"""Figure of merit → its power of metres."""

PAPER_COLOUR = "#BDBDBD"

ROOM = 0.2
"""A change this large has room for its number inside its bar."""


def steady_state_bars(results: Mapping[str, Result]) -> Figure:
    """Steady-state errors with and without the observer, and their change beside the paper's (Figure 21).

    Args:
        results: controller → result of one case, the paper's Case 4; `fando-nftsm` and `nftsm` are compared.

    Raises:
        ConfigurationError: one of the two is missing.
    """
    change = steady_change(results)
    if change is None:
        raise ConfigurationError(f"Figure 21 compares {WITH_OBSERVER} with {WITHOUT_OBSERVER}: both are needed")
    pair = {kind: ordered(results)[kind] for kind in (WITHOUT_OBSERVER, WITH_OBSERVER)}
    experiment = pair[WITH_OBSERVER].experiment
    start, end = experiment.steady_window
    number = case_number(experiment)
    title = "what the observer is worth in the steady state"
    title = f"Figure 21 · Case {number}: {title}" if number == 4 else title[0].upper() + title[1:]
    subtitle = f"{scenario(experiment).capitalize()}; steady state from {start:g} to {end:g} s"
    with house_style():
        figure = new_figure(5.0, title, subtitle, gap=0.07)
        panels = figure.subplot_mosaic([list(NAMES), ["change"] * 3], height_ratios=(1.25, 1))
        for metric in NAMES:
            _errors(panels[metric], pair, metric)
        _changes(panels["change"], change)
        handles = [Patch(facecolor=COLOURS[kind], label=LAW_NAMES[kind]) for kind in pair]
        legend_below(figure, [*handles, Patch(facecolor=PAPER_COLOUR, label="the paper's reduction")])
    return figure


def _errors(axes: Axes, pair: Mapping[str, Result], metric: str) -> None:
    values = {kind: getattr(result.metrics, f"steady_{metric}") for kind, result in pair.items()}
    power = POWERS[metric]
    unit, name = length_unit(max(values.values()) ** (1 / power))
    heights = [value / unit**power for value in values.values()]
    bars = axes.bar(range(len(pair)), heights, width=0.62, color=[COLOURS[kind] for kind in pair])
    axes.bar_label(bars, [three_digits(height) for height in heights], padding=2, fontsize=8.5)
    axes.set_xticks([])
    axes.set_xlim(-0.6, len(pair) - 0.4)
    axes.margins(y=0.14)
    axes.grid(visible=False)
    axes.set_title(f"{NAMES[metric]} ({name}{'²' if power == 2 else ''})")
    axes.tick_params(left=False, labelleft=False)
    axes.spines["left"].set_visible(False)


def _changes(axes: Axes, change: Mapping[str, float]) -> None:
    for place, (metric, paper) in enumerate(REDUCTIONS.items()):
        for offset, value, colour in (
            (-0.19, change[metric], COLOURS[WITH_OBSERVER]),
            (0.19, paper, PAPER_COLOUR),
        ):
            measured = offset < 0
            axes.barh(place + offset, 100 * value, height=0.34, color=colour)
            room = value < -ROOM
            axes.annotate(
                percent(value) if measured else percent(value, "+g"),
                (100 * value if room else min(100 * value, 0.0), place + offset),
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
