"""Estimates with their intervals beside what was believed, and how surprising each sensor was over time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from dualwinch.identification.blind import believed
from dualwinch.identification.found import Found
from dualwinch.identification.summary import headline, left
from dualwinch.model.quantities.quantity import behind_number
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import BLUE, GREY, VERMILION, house_style, plain

HEADING, A_ROW = 1.6, 0.34
"""Heights in inches."""

SHOWN = 0.5
"""Departure from 1 of root mean square surprises at which colours end."""

COLOURS = LinearSegmentedColormap.from_list("surprise", [BLUE, "white", VERMILION])


def identified_figure(found: Found, *, ax: GivenAxes = None) -> Figure:
    """Draw what logs say of a machine; see `Identified.plot`."""
    rows = range(len(found.keys))
    with house_style():
        page = Page(ax, HEADING + A_ROW * max(len(rows), 5), "What the logs say", headline(found))
        estimates, *sensors = page.panels(1, 2)
        by = believed(found.unknowns) / 100
        starts = np.array([unknown.start for unknown in found.unknowns])
        estimates.axvline(0, color=GREY, linewidth=1.0)
        estimates.errorbar(
            (found.values - starts) / by,
            rows,
            xerr=1.96 * found.deviations / by,
            fmt="o",
            color=BLUE,
            markersize=4,
            linewidth=1.5,
            capsize=2,
        )
        estimates.set_yticks(rows, [_labelled(found, row) for row in rows])
        estimates.set_ylim(len(rows) - 0.5, -0.5)
        known = any(unknown.prior for unknown in found.unknowns)
        estimates.set_xlabel("change, % of " + ("what was uncertain" if known else "what was believed"))
        for axes in sensors:
            _strips(found, axes)
    return page.figure


def _strips(found: Found, axes: Axes) -> None:
    """A strip of colour for each sensor: white where it surprised as much as expected."""
    tests = {test.name: left(test) for test in found.tests}
    names = list(found.courses)
    times = next(iter(found.courses.values()))[0]
    drawn = axes.pcolormesh(
        times,
        range(len(names)),
        np.array([found.courses[name][1] for name in names]),
        cmap=COLOURS,
        vmin=1 - SHOWN,
        vmax=1 + SHOWN,
        rasterized=True,
    )
    axes.grid(visible=False)
    axes.set_yticks(range(len(names)), [f"{name}\n{tests.get(name, '').partition(' after')[0]}" for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("time under way (s)")
    axes.figure.colorbar(drawn, ax=axes, extend="both", label="surprise, RMS (1: as expected)")


def _labelled(found: Found, row: int) -> str:
    """A key without what all have in common, and its estimate."""
    unknown, deviation = found.unknowns[row], found.deviations[row]
    key = unknown.key.removeprefix("plant.").removeprefix("sensors.").removeprefix("disturbance.")
    return f"{plain(key)}\n{found.values[row]:.5g} ± {deviation:.2g}{behind_number(unknown.unit)}"
