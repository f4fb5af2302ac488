"""How columns of a run change with its numbers, over the time: a panel a column, a line a number."""

from collections.abc import Mapping
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.curves import PALETTE, Look
from dualwinch.simulation.plots.headings import scenario
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import DASHES, GREY, house_style, law_label
from dualwinch.simulation.plots.thin import thin

Floats = NDArray[np.float64]


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
