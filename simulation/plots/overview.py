"""One run at a glance, and Figure 21: steady-state errors with and without the observer."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.paper import (
    COMPARED_CASE,
    REDUCTIONS,
    WITH_OBSERVER,
    WITHOUT_OBSERVER,
    percent,
    steady_change,
)
from dualwinch.simulation.plots.page import GivenAxes, case_number, new_page, scenario
from dualwinch.simulation.plots.runs import KILO, LIMIT, REFERENCE, Curve, Runs, curves, draw_limits, length_unit
from dualwinch.simulation.plots.style import GREY, INK, ROPE_COLOURS, zero_line
from dualwinch.simulation.plots.traces import largest
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
    run = replace(curves(result)[0], dashes="-")
    draw = [_trajectory, _error, _tensions, _force, *([_disturbance] if "d_hat" in result else [])]
    beside = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    with new_page(ax, 0.75 + 1.45 * len(draw), run.title, scenario(run.experiment).capitalize()) as page:
        panels = page.panels(len(draw), sharex=True)
        for axes, panel in zip(panels, draw, strict=True):
            panel(axes, run)
            axes.locator_params(axis="y", nbins=5)
            axes.legend(**beside, ncols=4, handlelength=1.8, columnspacing=1.2)
        page.time_axes(panels, run.experiment)
    return page.figure


def _trajectory(axes: Axes, run: Curve) -> None:
    run.draw(axes, "x", label="vehicle")
    run.draw(axes, "x_ref", **REFERENCE)
    axes.set(ylabel="position $x$ (m)", title="trajectory")


def _error(axes: Axes, run: Curve) -> None:
    unit, name = length_unit(largest(run.result["e"]))
    run.draw(axes, "e", unit, label=r"$x - x_\mathrm{ref}$")
    zero_line(axes)
    axes.set(ylabel=f"error $e$ ({name})", title="tracking error")
    steady = run.result.metrics.steady_mae
    if np.isfinite(steady):
        unit, name = length_unit(steady)
        axes.set_title(f"tracking error · mean |e| in the steady state (shaded): {steady / unit:.3g} {name}")


def _tensions(axes: Axes, run: Curve) -> None:
    for rope, colour in enumerate(ROPE_COLOURS, start=1):
        run.draw(axes, f"F{rope}_cmd", KILO, color=colour, alpha=0.25, linewidth=4, label=f"command {rope}")
        run.draw(axes, f"F{rope}", KILO, color=colour, linewidth=1.0, label=f"rope {rope}")
    draw_limits(axes, run.experiment, label=None)
    lowest, highest = run.result.metrics.min_tension / KILO, run.result.metrics.peak_tension / KILO
    words = f" · {lowest:.3g} to {highest:.3g} kN" if np.isfinite(highest) else ""
    axes.set(ylabel="tension (kN)", title=f"rope tensions{words}")


def _force(axes: Axes, run: Curve) -> None:
    limit = float(run.experiment.controller.limits.force) / KILO
    run.draw(axes, "u", KILO, color=GREY, linestyle="--", linewidth=1.0, label="asked for, $u$")
    run.draw(axes, "u_sat", KILO, label="given, sat $u$")
    words = "force"
    if largest(run.result["u"]) > limit * KILO:
        share = 100 * run.result.metrics.saturated_share
        words += f" · beyond ±{limit:g} kN" + (f" in {share:.3g} % of the run" if np.isfinite(share) else "")
        for edge in (-limit, limit):
            axes.axhline(edge, **LIMIT)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, -BEYOND * limit), min(top, BEYOND * limit))
    axes.set(ylabel="force (kN)", title=words)


def _disturbance(axes: Axes, run: Curve) -> None:
    run.draw(axes, "d_hat", 1e-3, label="estimate")
    run.draw(axes, "d_true", 1e-3, color=INK, linestyle=":", linewidth=1.0, label="true")
    axes.set(ylabel="$d$ (mm/s²)", title="disturbance acceleration")


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
    by_law = {run.experiment.controller.law.kind: run for run in reversed(curves(results))}
    change = steady_change({kind: run.result for kind, run in by_law.items()})
    if change is None:
        raise ConfigurationError(f"Figure 21 compares {WITH_OBSERVER} with {WITHOUT_OBSERVER}: both are needed")
    pair = [by_law[kind] for kind in (WITHOUT_OBSERVER, WITH_OBSERVER)]
    experiment = pair[1].experiment
    start, end = experiment.steady_window
    number = case_number(experiment)
    title = "effect of the observer in the steady state"
    title = f"Figure 21 · Case {number}: {title}" if number == COMPARED_CASE else title[0].upper() + title[1:]
    subtitle = f"{scenario(experiment).capitalize()}; steady state from {start:g} to {end:g} s"
    with new_page(ax, 5.0, title, subtitle, gap=0.07) as page:
        *errors, changes = page.mosaic([[*REDUCTIONS], ["change"] * len(REDUCTIONS)], height_ratios=(1.25, 1))
        for axes, metric in zip(errors, REDUCTIONS, strict=True):
            _errors(axes, pair, metric)
        _changes(changes, change, pair[1].colour)
        handles = [Patch(facecolor=run.colour, label=run.title) for run in pair]
        page.legend(*handles, Patch(facecolor=PAPER_COLOUR, label="the paper's reduction"))
    return page.figure


def _errors(axes: Axes, pair: Sequence[Curve], metric: str) -> None:
    quantity, values = metric_quantities()[metric], [run.result.metrics[f"steady_{metric}"] for run in pair]
    power = 2 if quantity.unit == "m^2" else 1
    unit, name = length_unit(max(values) ** (1 / power))
    heights = [value / unit**power for value in values]
    bars = axes.bar(range(len(pair)), heights, width=0.62, color=[run.colour for run in pair])
    axes.bar_label(bars, [three_digits(height) for height in heights], padding=2, fontsize=8.5)
    axes.margins(y=0.14)
    axes.grid(visible=False)
    axes.set(xticks=[], xlim=(-0.6, len(pair) - 0.4), title=f"{quantity.label} ({name}{'²' if power == 2 else ''})")
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
    axes.set_yticks(range(len(REDUCTIONS)), [metric_quantities()[metric].label for metric in REDUCTIONS])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(-100, max(0.0, axes.get_xlim()[1]) if max(change.values()) > 0 else 0)
    axes.set_xticks(range(-100, 1, 25), [percent(tick / 100, "g") for tick in range(-100, 1, 25)])
    axes.set_title("change by the observer: measured, and in the paper")


def three_digits(value: float) -> str:
    """A number with three significant digits, trailing zeros kept, e.g. 6.40."""
    return f"{value:#.3g}".removesuffix(".")
