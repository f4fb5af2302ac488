"""A motion that makes numbers visible, and how well each is then known, beside the motion there was."""

import numpy as np
from matplotlib.figure import Figure

from dualwinch.identification.blind import believed
from dualwinch.identification.excitation.designed import Designed
from dualwinch.model.reference import setpoint
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import BLUE, GREY, house_style, logarithmic, plain

POINTS = 600
"""Points of the motion."""

HEADING, A_ROW = 2.2, 0.2
"""Heights in inches."""


def excited_figure(designed: Designed, *, ax: GivenAxes = None) -> Figure:
    """Draw a motion and what to expect of it; see `Excited.plot`."""
    rows = range(len(designed.keys))
    with house_style():
        page = Page(ax, HEADING + A_ROW * max(len(rows), 4), "A run that tells", designed.headline)
        left, right = page.panels(1, 2)
        t = np.linspace(0, designed.duration, POINTS)
        left.plot(t, setpoint(t, designed.experiment.reference).x, color=BLUE)
        left.set(xlabel="time (s)", ylabel="reference (m)", xlim=(0, designed.duration))
        by = believed(designed.unknowns) / 100
        before, after = designed.present_deviations / by, designed.deviations / by
        right.hlines(rows, before, after, color=GREY, linewidth=1.0)
        right.plot(before, rows, "o", color="white", markeredgecolor=GREY, markersize=5, label="present motion")
        right.plot(after, rows, "o", color=BLUE, markersize=5, label="this motion")
        right.set_yticks(rows, [plain(key.removeprefix("plant.").removeprefix("sensors.")) for key in designed.keys])
        right.set_ylim(len(rows) - 0.5, -0.5)
        logarithmic(right, between=(1, 2, 5))
        right.set_xlabel("deviation to expect, % of the number")
        page.legend(list(right.get_lines()))
    return page.figure
