"""Figures of analyses: V(t) of the certificate, preload over time, and effects of numbers on a run."""

from collections.abc import Mapping
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.simulation.analysis.preload import Preloads
from dualwinch.simulation.analysis.stability import Certificate
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes, Page, scenario
from dualwinch.simulation.plots.runs import PALETTE, Look, length_unit
from dualwinch.simulation.plots.style import (
    BLUE,
    DASHES,
    GOLD,
    GREEN,
    GREY,
    INK,
    PURPLE,
    VERMILION,
    WINE,
    house_style,
    law_label,
    plain,
)
from dualwinch.simulation.plots.traces import Floats, largest, peaks, thin

INTERVALS = 250
"""Intervals of a run; each shows its largest value."""

DECADES = 12.0
"""Decades below the largest value that are drawn."""

TERMS = {
    "surface": ("$s^2/2$", BLUE),
    "auxiliary": ("$Z_a^2/2$", GOLD),
    "estimate": (r"$M \tilde{d}^2/(2L)$", PURPLE),
    "adaptation": (r"$\Delta L^2/(2K_f)$", WINE),
}
"""Term of V → its formula and colour."""


def lyapunov(certificate: Certificate, *, ax: GivenAxes = None) -> Figure:
    """V with its terms, and dV/dt where it is positive and where negative, both on logarithmic axes.

    Args:
        certificate: of a run of at least two samples.
        ax: axes for V and for its rate; default: a figure of its own.

    Raises:
        ConfigurationError: the run ended with its first sample.
    """
    if not certificate.rate.size:
        raise ConfigurationError("V along a run needs at least two samples")
    experiment = certificate.result.experiment
    words = f"V decreases over {100 * certificate.decreasing:.3g} % of the samples"
    holding = [condition.holds for condition in certificate.conditions]
    words += f"; {sum(holding)} of {len(holding)} conditions hold"
    title = f"{plain(law_label(experiment))}: the theorem's Lyapunov function"
    with house_style():
        page = Page(ax, 5.4, title, f"{scenario(experiment).capitalize()}. {words}")
        panels = page.panels(2, sharex=True, height_ratios=(1.15, 1))
        for axes, draw in zip(panels, (_value, _rate), strict=False):
            draw(axes, certificate, experiment.duration / INTERVALS)
        page.time_axes(panels, experiment)
        handles = [Line2D([], [], color=INK, linewidth=1.5, label="$V$")]
        handles += [Line2D([], [], color=colour, label=formula) for formula, colour in TERMS.values()]
        handles += [
            Line2D([], [], color=VERMILION, label="dV/dt > 0"),
            Line2D([], [], color=GREEN, label="dV/dt < 0"),
        ]
        page.legend(handles)
    return page.figure


def _value(axes: Axes, certificate: Certificate, width: float) -> None:
    t = certificate.result["t"]
    for name, (_, colour) in TERMS.items():
        values = getattr(certificate.terms, name)
        if np.any(values):
            axes.plot(*peaks(t, values, width), color=colour, linewidth=0.9)
    axes.plot(*peaks(t, certificate.terms.total, width), color=INK, linewidth=1.5)
    _decades(axes, certificate.terms.total)
    axes.set_ylabel("V and its terms")
    axes.set_title("V, largest value of every interval", color=GREY)


def _rate(axes: Axes, certificate: Certificate, width: float) -> None:
    t, rate = certificate.result["t"], certificate.rate
    for sign, colour in ((1.0, VERMILION), (-1.0, GREEN)):
        part = np.where(sign * rate > 0, rate, 0.0)
        axes.plot(*peaks(t[:-1], part, width), color=colour, linewidth=1.0)
    _decades(axes, rate)
    axes.set_ylabel("|dV/dt| (1/s)")
    axes.set_title("rate of V, largest of every interval, by its sign", color=GREY)


def _decades(axes: Axes, values: np.ndarray) -> None:
    """A logarithmic axis down to `DECADES` below the largest value."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    axes.set_yscale("log")
    if largest > 0:
        axes.set_ylim(max(largest * 10**-DECADES, 1e-300), 3 * largest)


COLOURS = {"constant": GREY, "best constant": VERMILION, "scheduled": BLUE}
"""Run → colour."""

OPTIMUM = {"color": GREEN, "linestyle": (0, (4, 2)), "linewidth": 1.0}
"""How the least preload is drawn."""


def preloads(found: Preloads, *, ax: GivenAxes = None) -> Figure:
    """Sum of both tensions, the smaller of them, and the error, of every preload over time.

    Args:
        found: the preloads.
        ax: axes for the three panels; default: a figure of its own.
    """
    runs = {"constant": found.constant, "best constant": found.best, "scheduled": found.scheduled}
    kept = {name: run for name, run in runs.items() if run is not None}
    experiment = found.scheduled.experiment
    loads = ", ".join(f"{name} {run.metrics.continuous_load:.1f}" for name, run in kept.items())
    words = f"Continuous load in N m: {loads}, least {found.least.continuous_load:.1f}"
    with house_style():
        page = Page(ax, 5.8, f"What preload costs: {scenario(experiment)}", words)
        panels = page.panels(3, sharex=True, height_ratios=(1.3, 1, 1))
        unit, name_of_unit = length_unit(max(largest(run["e"]) for run in kept.values()))
        for name, run in kept.items():
            t, F1, F2 = run["t"], run["F1"], run["F2"]
            for axes, values in zip(panels, ((F1 + F2) / 1e3, np.minimum(F1, F2) / 1e3, run["e"] / unit), strict=False):
                _draw(axes, t, values, COLOURS[name])
        least = found.least
        for axes, values in zip(panels, (least.preload, np.minimum(least.F1, least.F2)), strict=False):
            axes.plot(least.t, values / 1e3, **OPTIMUM)
        labels = ("sum of tensions (kN)", "smaller tension (kN)", f"error $e$ ({name_of_unit})")
        for axes, label in zip(panels, labels, strict=False):
            axes.set_ylabel(label)
        for axes in panels[1:2]:
            axes.axhline(experiment.controller.limits.tension_min / 1e3, color=INK, linewidth=0.7, linestyle=":")
        page.time_axes(panels, experiment)
        page.align()
        handles = [Line2D([], [], color=COLOURS[name], label=_words(name, found)) for name in kept]
        page.legend([*handles, Line2D([], [], label="least there could be", **OPTIMUM)])
    return page.figure


def _draw(axes: Axes, t: Floats, values: Floats, colour: str) -> None:
    axes.plot(*thin(t, values), color=colour, linewidth=1.0)


def _words(name: str, found: Preloads) -> str:
    run = {"constant": found.constant, "best constant": found.best}.get(name)
    return name if run is None else f"{name}, {run.experiment.controller.limits.preload:.0f} N"


READABLE = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}
"""Unit of a column → the one its changes are drawn in, and its number in the column's own."""


def effects_figure(
    experiment: Experiment,
    changes: Mapping[str, Mapping[str, Floats]],
    quantities: Mapping[str, Quantity],
    *,
    ax: GivenAxes = None,
) -> Figure:
    """Draw changes of columns.

    Args:
        experiment: what was run.
        changes: column → what is changed, in words → change of the column (samples,).
        quantities: column → what it is.
        ax: axes for the columns; default: a figure of its own.
    """
    t: Floats = np.arange(experiment.samples, dtype=np.float64) * experiment.simulation.sample_time
    labels = list(next(iter(changes.values())))
    looks: dict[str, Look] = dict(
        zip(labels, cycle((colour, dashes) for dashes in DASHES for colour in reversed(PALETTE)), strict=False)
    )
    with house_style():
        words = f"{law_label(experiment)}; {scenario(experiment)}"
        page = Page(ax, 1.2 + 1.6 * len(changes) + 0.09 * len(labels), "Changes to first order", words)
        panels = page.panels(len(changes), sharex=True)
        for axes, (column, lines) in zip(panels, changes.items(), strict=False):
            axes.axhline(0.0, color=GREY, linewidth=0.7)
            unit, scale = READABLE.get(quantities[column].unit, (readable_unit(quantities[column].unit), 1.0))
            for label, values in lines.items():
                colour, dashes = looks[label]
                axes.plot(*thin(t, scale * values), color=colour, linestyle=dashes)
            axes.set_ylabel(f"change of {column} ({unit})" if unit else f"change of {column}")
            axes.set_title(readable(quantities[column].meaning))
        page.time_axes(panels, experiment)
        page.align()
        page.legend(
            [Line2D([], [], color=colour, linestyle=dashes, label=label) for label, (colour, dashes) in looks.items()]
        )
    return page.figure
