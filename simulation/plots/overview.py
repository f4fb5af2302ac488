"""One run at a glance: what ``dualwinch simulate --plot FILE`` shows."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dualwinch.simulation.plots.curves import Curve, curves, ending
from dualwinch.simulation.plots.headings import scenario
from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.ropes import KILO, draw_limits
from dualwinch.simulation.plots.style import GREY, INK, ROPE_COLOURS, house_style, shade
from dualwinch.simulation.plots.thin import largest, thin
from dualwinch.simulation.results.result import Result

BEYOND = 1.25
"""How far, in limits, the force panel reaches; a command beyond is told in words."""


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
