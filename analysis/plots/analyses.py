"""Figures of analyses: V(t) of the certificate, preload over time, and effects of parameters on a run."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dualwinch.analysis.preload import Preloads
from dualwinch.analysis.stability import Certificate
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes, new_page, scenario
from dualwinch.simulation.plots.runs import KILO, PALETTE, length_unit
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    PURPLE,
    VERMILION,
    WINE,
    law_label,
    looks,
    plain,
)
from dualwinch.simulation.plots.traces import Floats, largest, peaks, thin

INTERVALS = 250
"""Intervals of a run; each shows its largest value."""

DECADES = 12.0
"""Decades shown below the largest value."""

TERMS = {
    "surface": ("$s^2/2$", BLUE),
    "auxiliary": ("$Z_a^2/2$", GOLD),
    "estimate": (r"$M \tilde{d}^2/(2L)$", PURPLE),
    "adaptation": (r"$\Delta L^2/(2K_f)$", WINE),
}
"""Term of V → its formula and colour."""


def lyapunov(certificate: Certificate, *, ax: GivenAxes = None) -> Figure:
    """V with its terms, and positive and negative parts of dV/dt, on logarithmic axes.

    Panels: V, and its rate.

    Raises:
        ConfigurationError: the run ended with its first sample.
    """
    if not certificate.rate.size:
        raise ConfigurationError("V along a run needs at least two samples")
    experiment, t = certificate.result.experiment, certificate.result["t"]
    width, total = experiment.duration / INTERVALS, certificate.terms.total
    holding = [condition.holds for condition in certificate.conditions]
    words = f"{scenario(experiment).capitalize()}. V decreases over {100 * certificate.decreasing:.3g} % of the samples"
    words += f"; {sum(holding)} of {len(holding)} conditions hold"
    with new_page(ax, 5.4, f"{plain(law_label(experiment))}: the theorem's Lyapunov function", words) as page:
        value, rate = panels = page.panels(2, sharex=True, height_ratios=(1.15, 1))
        value.plot(*peaks(t, total, width), color=INK, linewidth=1.5, label="$V$", zorder=3)
        for name, (formula, colour) in TERMS.items():
            if np.any(values := getattr(certificate.terms, name)):
                value.plot(*peaks(t, values, width), color=colour, linewidth=0.9, label=formula)
        for sign, colour, label in ((1.0, VERMILION, "dV/dt > 0"), (-1.0, GREEN, "dV/dt < 0")):
            part = np.where(sign * certificate.rate > 0, certificate.rate, 0.0)
            rate.plot(*peaks(t[:-1], part, width), color=colour, linewidth=1.0, label=label)
        _decades(value, total)
        _decades(rate, certificate.rate)
        value.set_ylabel("V and its terms")
        value.set_title("V, largest value of every interval", color=GREY)
        rate.set_ylabel("|dV/dt| (1/s)")
        rate.set_title("rate of V, largest of every interval, by its sign", color=GREY)
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure


def _decades(axes: Axes, values: np.ndarray) -> None:
    """A logarithmic axis down to `DECADES` below the largest value."""
    highest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    axes.set_yscale("log")
    if highest > 0:
        axes.set_ylim(max(highest * 10**-DECADES, 1e-300), 3 * highest)


PRELOAD_COLOURS = {"as configured": GOLD, "constant": GREY, "best constant": VERMILION, "scheduled": BLUE}
"""Run → colour."""


def preloads(found: Preloads, *, ax: GivenAxes = None) -> Figure:
    """Sum of both tensions, smaller tension, and error over time, for every preload; a panel each."""
    experiment, best = found.scheduled.experiment, found.optimum
    loads = ", ".join(f"{name} {run.metrics.continuous_load:.1f}" for name, run in found.runs.items())
    words = f"Continuous load in N m: {loads}, optimum {best.continuous_load:.1f}"
    with new_page(ax, 5.8, f"What preload costs: {scenario(experiment)}", words) as page:
        total, smaller, _ = panels = page.panels(3, sharex=True, height_ratios=(1.3, 1, 1))
        unit, name_of_unit = length_unit(max(largest(run["e"]) for run in found.runs.values()))
        for name, run in found.runs.items():
            constant = f", {run.experiment.controller.limits.preload:.0f} N" if run is not found.scheduled else ""
            signals = (run["F1"] + run["F2"]) / KILO, np.minimum(run["F1"], run["F2"]) / KILO, run["e"] / unit
            for axes, values in zip(panels, signals, strict=True):
                axes.plot(*thin(run["t"], values), color=PRELOAD_COLOURS[name], linewidth=1.0, label=name + constant)
        optimum = {"color": GREEN, "linestyle": (0, (4, 2)), "linewidth": 1.0, "label": "optimum"}
        total.plot(best.t, best.preload / KILO, **optimum)
        smaller.plot(best.t, np.minimum(best.F1, best.F2) / KILO, **optimum)
        smaller.axhline(experiment.controller.limits.tension_min / KILO, color=INK, linewidth=0.7, linestyle=":")
        labels = ("sum of tensions (kN)", "smaller tension (kN)", f"error $e$ ({name_of_unit})")
        for axes, label in zip(panels, labels, strict=True):
            axes.set_ylabel(label)
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure


READABLE = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}
"""Unit of a column → unit of its changes in figures, and factor to it."""


def effects_figure(
    experiment: Experiment,
    changes: Mapping[str, Mapping[str, Floats]],
    quantities: Mapping[str, Quantity],
    *,
    ax: GivenAxes = None,
) -> Figure:
    """First-order changes of columns of a run (column → label → (samples,)), one panel per column."""
    t: Floats = np.arange(experiment.samples, dtype=np.float64) * experiment.simulation.sample_time
    styles = looks(next(iter(changes.values())), PALETTE[::-1])
    height, words = 1.2 + 1.6 * len(changes) + 0.09 * len(styles), f"{law_label(experiment)}; {scenario(experiment)}"
    with new_page(ax, height, "Changes to first order", words) as page:
        panels = page.panels(len(changes), sharex=True)
        for axes, (column, lines) in zip(panels, changes.items(), strict=True):
            axes.axhline(0.0, color=GREY, linewidth=0.7)
            unit, scale = READABLE.get(quantities[column].unit, (readable_unit(quantities[column].unit), 1.0))
            for label, values in lines.items():
                axes.plot(*thin(t, scale * values), **styles[label], label=label)
            axes.set(
                ylabel=f"change of {column} ({unit})" if unit else f"change of {column}",
                title=readable(quantities[column].meaning),
            )
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure
