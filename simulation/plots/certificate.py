"""The Lyapunov function of the stability theorem along a run, and whether it decreases."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.analysis.certificate import Certificate
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    LAW_NAMES,
    PURPLE,
    VERMILION,
    WINE,
    house_style,
    legend_below,
    new_figure,
    scenario,
    time_axis,
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


def lyapunov(certificate: Certificate) -> Figure:
    """V with its terms, and dV/dt where it is positive and where negative, both on logarithmic axes.

    Args:
        certificate: of a run of at least two samples.

    Raises:
        ConfigurationError: the run ended with its first sample.
    """
    result = certificate.result
    if not certificate.rate.size:
        raise ConfigurationError("V along a run needs at least two samples")
    experiment, t = result.experiment, result["t"]
    width = experiment.duration / INTERVALS
    law = LAW_NAMES[experiment.controller.law.kind]
    title = f"{law}: the theorem's Lyapunov function"
    words = f"V decreases over {100 * certificate.decreasing:.3g} % of the samples"
    holding = [condition.holds for condition in certificate.conditions]
    words += f"; {sum(holding)} of {len(holding)} conditions hold"
    with house_style():
        figure = new_figure(5.4, title, f"{scenario(experiment).capitalize()}. {words}")
        value, rate = figure.subplots(2, 1, sharex=True, height_ratios=(1.15, 1))
        for name, (_, colour) in TERMS.items():
            values = getattr(certificate.terms, name)
            if np.any(values):
                value.plot(*peaks(t, values, width), color=colour, linewidth=0.9)
        value.plot(*peaks(t, certificate.terms.total, width), color=INK, linewidth=1.5)
        for sign, colour in ((1.0, VERMILION), (-1.0, GREEN)):
            part = np.where(sign * certificate.rate > 0, certificate.rate, 0.0)
            rate.plot(*peaks(t[:-1], part, width), color=colour, linewidth=1.0)
        for axes, values in ((value, certificate.terms.total), (rate, certificate.rate)):
            _decades(axes, values)
        value.set_ylabel("V and its terms")
        value.set_title("V, largest value of every interval", color=GREY)
        rate.set_ylabel("|dV/dt| (1/s)")
        rate.set_title("rate of V, largest of every interval, by its sign", color=GREY)
        time_axis(rate, experiment)
        handles = [Line2D([], [], color=INK, linewidth=1.5, label="$V$")]
        handles += [Line2D([], [], color=colour, label=formula) for formula, colour in TERMS.values()]
        handles += [
            Line2D([], [], color=VERMILION, label="dV/dt > 0"),
            Line2D([], [], color=GREEN, label="dV/dt < 0"),
        ]
        legend_below(figure, [*handles])
    return figure


def _decades(axes: Axes, values: np.ndarray) -> None:
    """A logarithmic axis down to `DECADES` below the largest value."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    axes.set_yscale("log")
    if largest > 0:
        axes.set_ylim(max(largest * 10**-DECADES, 1e-300), 3 * largest)
