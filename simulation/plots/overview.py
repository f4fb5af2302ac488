"""One run at a glance: what ``dualwinch simulate --plot FILE`` shows."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.ropes import KILO, draw_limits
from dualwinch.simulation.plots.style import (
    COLOURS,
    GREY,
    INK,
    ROPE_COLOURS,
    house_style,
    label,
    new_figure,
    ordered,
    scenario,
    shade,
    time_axis,
)
from dualwinch.simulation.plots.thin import LARGEST, thin
from dualwinch.simulation.result import Result

BEYOND = 1.25
"""How far, in limits, the force panel reaches; a command beyond is told in words."""


def overview(result: Result) -> Figure:
    """Trajectory, error, tensions with commands, force and, where there is an observer, the disturbance.

    Args:
        result: one run.

    Raises:
        ConfigurationError: the run keeps no rows.
    """
    kind = result.experiment.controller.law.kind
    ordered({kind: result})
    draw: list[Callable[[Axes, Result], None]] = [_trajectory, _error, _tensions, _force]
    if "d_hat" in result.columns:
        draw.append(_disturbance)
    with house_style():
        figure = new_figure(0.75 + 1.45 * len(draw), label(kind, result), scenario(result.experiment).capitalize())
        panels = figure.subplots(len(draw), 1, sharex=True)
        for axes, panel in zip(panels, draw, strict=True):
            shade(axes, result.experiment)
            panel(axes, result)
            axes.locator_params(axis="y", nbins=5)
            axes.legend(
                loc="lower right",
                bbox_to_anchor=(1.0, 1.0),
                ncols=4,
                borderaxespad=0.1,
                handlelength=1.8,
                columnspacing=1.2,
            )
        time_axis(panels[-1], result.experiment)
        figure.align_ylabels(panels)
    return figure


def _trajectory(axes: Axes, result: Result) -> None:
    axes.plot(*thin(result["t"], result["x"]), color=_colour(result), label="vehicle")
    axes.plot(*thin(result["t"], result["x_ref"]), color=INK, linestyle=":", linewidth=1.0, label="reference")
    axes.set_ylabel("position $x$ (m)")
    axes.set_title("trajectory")


def _error(axes: Axes, result: Result) -> None:
    unit, name = length_unit(result.metrics.max_abs_error)
    axes.plot(*thin(result["t"], result["e"] / unit), color=_colour(result), label=r"$x - x_\mathrm{ref}$")
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    axes.set_ylabel(f"error $e$ ({name})")
    steady = result.metrics.steady_mae
    words = ""
    if np.isfinite(steady):
        unit, name = length_unit(steady)
        words = f" · mean |e| in the steady state (shaded): {steady / unit:.3g} {name}"
    axes.set_title("tracking error" + words)


def _tensions(axes: Axes, result: Result) -> None:
    for rope, colour in enumerate(ROPE_COLOURS, start=1):
        t, command = thin(result["t"], result[f"F{rope}_cmd"] / KILO)
        axes.plot(t, command, color=colour, alpha=0.25, linewidth=4, label=f"command {rope}")
        axes.plot(*thin(result["t"], result[f"F{rope}"] / KILO), color=colour, linewidth=1.0, label=f"rope {rope}")
    draw_limits(axes, result.experiment)
    axes.set_ylabel("tension (kN)")
    metrics = result.metrics
    axes.set_title(f"rope tensions · {metrics.min_tension / KILO:.3g} to {metrics.peak_tension / KILO:.3g} kN")


def _force(axes: Axes, result: Result) -> None:
    limits = result.experiment.controller.limits
    limit = float(limits.force) / KILO
    u, u_sat = result["u"] / KILO, result["u_sat"] / KILO
    axes.plot(*thin(result["t"], u), color=GREY, linestyle="--", linewidth=1.0, label="asked for, $u$")
    axes.plot(*thin(result["t"], u_sat), color=_colour(result), label="given, sat $u$")
    axes.set_ylabel("force (kN)")
    words = "force"
    beyond = np.abs(np.where(np.abs(u) <= LARGEST, u, np.nan))
    if np.isfinite(beyond).any() and np.nanmax(beyond) > limit:
        words += f" · beyond ±{limit:g} kN in {100 * result.metrics.saturated_share:.3g} % of the run"
        for edge in (-limit, limit):
            axes.axhline(edge, color=INK, linestyle=(0, (2, 2)), linewidth=0.8, zorder=1.5)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, -BEYOND * limit), min(top, BEYOND * limit))
    axes.set_title(words)


def _disturbance(axes: Axes, result: Result) -> None:
    axes.plot(*thin(result["t"], result["d_hat"] * 1e3), color=_colour(result), label="estimate")
    t, true = thin(result["t"], result["d_true"] * 1e3)
    axes.plot(t, true, color=INK, linestyle=":", linewidth=1.0, label="true")
    axes.set_ylabel("$d$ (mm/s²)")
    axes.set_title("disturbance acceleration")


def _colour(result: Result) -> str:
    return COLOURS[result.experiment.controller.law.kind]
