"""Estimates with their intervals over what was believed, and how surprising readings were over time."""

import numpy as np
from matplotlib.figure import Figure

from dualwinch.identification.blind import believed
from dualwinch.identification.found import Found
from dualwinch.identification.summary import headline
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import BLUE, GOLD, GREEN, GREY, PURPLE, SKY, VERMILION, WINE, house_style, plain

COLOURS = (BLUE, SKY, VERMILION, GOLD, GREEN, PURPLE, WINE, GREY)
"""Of the sensors."""

HEADING, A_ROW = 2.2, 0.2
"""Heights in inches."""

BEYOND = 3.0
"""Root mean square of whitened surprises up to which the axis goes, at least."""


def identified_figure(found: Found, *, ax: GivenAxes = None) -> Figure:
    """Draw what logs say of a machine; see `Identified.plot`."""
    rows = len(found.keys)
    with house_style():
        page = Page(ax, HEADING + A_ROW * max(rows, 6), "What the logs say", headline(found))
        left, right = page.panels(1, 2)
        by = believed(found.unknowns)
        starts = np.array([unknown.start for unknown in found.unknowns])
        moved, spread = (found.values - starts) / by, 1.96 * found.deviations / by
        left.axvline(0, color=GREY, linewidth=1.0)
        left.errorbar(moved, range(rows), xerr=spread, fmt="o", color=BLUE, markersize=4, linewidth=1.5)
        left.set_yticks(range(rows), [plain(_short(key)) for key in found.keys])
        left.set_ylim(rows - 0.5, -0.5)
        left.set_xlabel("change from what was believed, over its size or its deviation")
        for (name, course), colour in zip(found.courses.items(), COLOURS, strict=False):
            right.plot(*course, color=colour, linewidth=1.0, label=name)
        right.axhline(1, color=GREY, linewidth=1.0)
        right.set(xlabel="time (s)", ylabel="surprise over what is expected of it (RMS)", ylim=(0, None))
        right.legend()
    return page.figure


def _short(key: str) -> str:
    """A key without what all have in common."""
    return key.removeprefix("plant.").removeprefix("sensors.")
