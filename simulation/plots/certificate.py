"""The Lyapunov function of the stability theorem along a run, and whether it decreases."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.analysis.stability import Certificate
from dualwinch.simulation.plots.headings import scenario
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import (
    BLUE,
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
from dualwinch.simulation.plots.thin import peaks

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
