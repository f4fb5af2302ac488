"""Figures: estimates with their innovations, and a motion with the deviations to expect."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dualwinch.identification.unknowns import UnknownParameter
from dualwinch.model.quantities.quantity import behind_number
from dualwinch.model.reference import Reference, setpoint
from dualwinch.simulation.plots.page import GivenAxes, new_page
from dualwinch.simulation.plots.style import BLUE, GREY, VERMILION, logarithmic, plain

Floats = NDArray[np.float64]

COLOURS = LinearSegmentedColormap.from_list("innovation", [BLUE, "white", VERMILION])


def identification_figure(
    headline: str,
    unknowns: Sequence[UnknownParameter],
    values: Floats,
    deviations: Floats,
    innovations: Mapping[str, Floats],
    verdicts: Mapping[str, str],
    *,
    ax: GivenAxes = None,
) -> Figure:
    """Draw estimates with their intervals beside their starts; see `identification.result.IdentificationResult`."""
    rows = range(len(unknowns))
    with new_page(ax, 1.6 + 0.34 * max(len(rows), 5), "What the logs say", headline) as page:
        estimates, sensors = page.panels(1, 2)
        by = np.array([unknown.uncertainty for unknown in unknowns]) / 100
        starts = np.array([unknown.start for unknown in unknowns])
        estimates.axvline(0, color=GREY, linewidth=1.0)
        estimates.errorbar(
            (values - starts) / by,
            rows,
            xerr=1.96 * deviations / by,
            fmt="o",
            color=BLUE,
            markersize=4,
            linewidth=1.5,
            capsize=2,
        )
        estimates.set_yticks(rows, [*map(_estimate_label, unknowns, values.tolist(), deviations.tolist())])
        estimates.set_ylim(len(rows) - 0.5, -0.5)
        known = any(unknown.prior for unknown in unknowns)
        estimates.set_xlabel("change, % of " + ("the prior deviation" if known else "the start"))
        _innovation_strips(innovations, verdicts, sensors)
    return page.figure


def _innovation_strips(
    innovations: Mapping[str, Floats], verdicts: Mapping[str, str], axes: Axes, shown: float = 0.5
) -> None:
    """A strip of colour for each sensor: white where its innovations are as large as expected.

    Colours end where root mean squares depart from 1 by `shown`.
    """
    names = list(innovations)
    drawn = axes.pcolormesh(
        next(iter(innovations.values()))[0],
        range(len(names)),
        np.array([innovations[name][1] for name in names]),
        cmap=COLOURS,
        vmin=1 - shown,
        vmax=1 + shown,
        rasterized=True,
    )
    axes.grid(visible=False)
    axes.set_yticks(range(len(names)), [f"{name}\n{verdicts.get(name, '').partition(' at lag')[0]}" for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("time in motion (s)")
    axes.figure.colorbar(drawn, ax=axes, extend="both", label="innovations, RMS (1: as expected)")


def _estimate_label(unknown: UnknownParameter, value: float, deviation: float) -> str:
    """A key without what all have in common, and its estimate."""
    key = unknown.key.removeprefix("plant.").removeprefix("sensors.").removeprefix("disturbance.")
    return f"{plain(key)}\n{value:.5g} ± {deviation:.2g}{behind_number(unknown.unit)}"


def excitation_figure(
    headline: str,
    reference: Reference,
    duration: float,
    unknowns: Sequence[UnknownParameter],
    present: Floats,
    deviations: Floats,
    *,
    ax: GivenAxes = None,
) -> Figure:
    """Draw a motion, and the deviations to expect of it; see `identification.excitation.ExcitationDesign`."""
    rows = range(len(unknowns))
    with new_page(ax, 2.2 + 0.2 * max(len(rows), 4), "An informative run", headline) as page:
        left, right = page.panels(1, 2)
        t = np.linspace(0, duration, 600)
        left.plot(t, setpoint(t, reference).x, color=BLUE)
        left.set(xlabel="time (s)", ylabel="reference (m)", xlim=(0, duration))
        by = np.array([unknown.uncertainty for unknown in unknowns]) / 100
        before, after = present / by, deviations / by
        right.hlines(rows, before, after, color=GREY, linewidth=1.0)
        right.plot(before, rows, "o", color="white", markeredgecolor=GREY, markersize=5, label="present motion")
        right.plot(after, rows, "o", color=BLUE, markersize=5, label="this motion")
        right.set_yticks(rows, [plain(each.key.removeprefix("plant.").removeprefix("sensors.")) for each in unknowns])
        right.set_ylim(len(rows) - 0.5, -0.5)
        logarithmic(right, between=(1, 2, 5))
        right.set_xlabel("deviation to expect, % of the parameter")
        page.legend()
    return page.figure
