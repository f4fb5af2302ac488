"""One run at a glance, and Figure 21: steady-state errors with and without the observer."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import REDUCTIONS, WITH_OBSERVER, WITHOUT_OBSERVER, percent, steady_change
from dualwinch.simulation.plots.page import GivenAxes, Page, case_number, scenario
from dualwinch.simulation.plots.runs import KILO, Curve, Runs, curves, draw_limits, ending, length_unit
from dualwinch.simulation.plots.style import GREY, INK, ROPE_COLOURS, house_style, law_kind, shade
from dualwinch.simulation.plots.traces import largest, thin
from dualwinch.simulation.results.result import Result

BEYOND = 1.25
"""How far, in limits, the force panel reaches; a command beyond is given in words."""


def overview(result: Result, *, ax: GivenAxes = None) -> Figure:
    """Trajectory, error, tensions with commands, force and, where there is an observer, the disturbance.

    Args:
        result: one run.
        ax: axes for these; default: a figure of its own.

    Raises:
        ConfigurationError: the run keeps no rows.
    """
    (run,) = curves(result)
    draw: list[Callable[[Axes, Curve], None]] = [_trajectory, _error, _tensions, _force]
    if "d_hat" in result:
        draw.append(_disturbance)
    title, subtitle = f"{run.label}{ending(result)}", scenario(run.experiment).capitalize()
    with house_style():
        page = Page(ax, 0.75 + 1.45 * len(draw), title, subtitle)
        panels = page.panels(len(draw), sharex=True)
        for axes, panel in zip(panels, draw, strict=False):
            shade(axes, run.experiment)
            panel(axes, run)
            axes.locator_params(axis="y", nbins=5)
            axes.legend(
                loc="lower right",
                bbox_to_anchor=(1.0, 1.0),
                ncols=4,
                borderaxespad=0.1,
                handlelength=1.8,
                columnspacing=1.2,
            )
        page.time_axes(panels, run.experiment)
        page.align()
    return page.figure


def _trajectory(axes: Axes, run: Curve) -> None:
    result = run.result
    axes.plot(*thin(result["t"], result["x"]), color=run.colour, label="vehicle")
    axes.plot(*thin(result["t"], result["x_ref"]), color=INK, linestyle=":", linewidth=1.0, label="reference")
    axes.set_ylabel("position $x$ (m)")
    axes.set_title("trajectory")


def _error(axes: Axes, run: Curve) -> None:
    result = run.result
    unit, name = length_unit(largest(result["e"]))
    axes.plot(*thin(result["t"], result["e"] / unit), color=run.colour, label=r"$x - x_\mathrm{ref}$")
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    axes.set_ylabel(f"error $e$ ({name})")
    steady = result.metrics.steady_mae
    words = ""
    if np.isfinite(steady):
        unit, name = length_unit(steady)
        words = f" · mean |e| in the steady state (shaded): {steady / unit:.3g} {name}"
    axes.set_title("tracking error" + words)


def _tensions(axes: Axes, run: Curve) -> None:
    result = run.result
    for rope, colour in enumerate(ROPE_COLOURS, start=1):
        t, command = thin(result["t"], result[f"F{rope}_cmd"] / KILO)
        axes.plot(t, command, color=colour, alpha=0.25, linewidth=4, label=f"command {rope}")
        axes.plot(*thin(result["t"], result[f"F{rope}"] / KILO), color=colour, linewidth=1.0, label=f"rope {rope}")
    draw_limits(axes, result.experiment)
    axes.set_ylabel("tension (kN)")
    lowest, highest = result.metrics.min_tension / KILO, result.metrics.peak_tension / KILO
    axes.set_title("rope tensions" + (f" · {lowest:.3g} to {highest:.3g} kN" if np.isfinite(highest) else ""))


def _force(axes: Axes, run: Curve) -> None:
    result = run.result
    limit = float(result.experiment.controller.limits.force) / KILO
    u, u_sat = result["u"] / KILO, result["u_sat"] / KILO
    axes.plot(*thin(result["t"], u), color=GREY, linestyle="--", linewidth=1.0, label="asked for, $u$")
    axes.plot(*thin(result["t"], u_sat), color=run.colour, label="given, sat $u$")
    axes.set_ylabel("force (kN)")
    words = "force"
    if largest(u) > limit:
        share = 100 * result.metrics.saturated_share
        words += f" · beyond ±{limit:g} kN" + (f" in {share:.3g} % of the run" if np.isfinite(share) else "")
        for edge in (-limit, limit):
            axes.axhline(edge, color=INK, linestyle=(0, (2, 2)), linewidth=0.8, zorder=1.5)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, -BEYOND * limit), min(top, BEYOND * limit))
    axes.set_title(words)


def _disturbance(axes: Axes, run: Curve) -> None:
    result = run.result
    axes.plot(*thin(result["t"], result["d_hat"] * 1e3), color=run.colour, label="estimate")
    t, true = thin(result["t"], result["d_true"] * 1e3)
    axes.plot(t, true, color=INK, linestyle=":", linewidth=1.0, label="true")
    axes.set_ylabel("$d$ (mm/s²)")
    axes.set_title("disturbance acceleration")


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
