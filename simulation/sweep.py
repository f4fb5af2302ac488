"""Runs over a grid of keys, and their figure."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dualwinch.simulation.batch.sweep import Grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Grid):
    """What `dualwinch.sweep` gives: a grid of runs that can be drawn."""

    def plot(self, metric: str, ax: "Axes | None" = None) -> "Figure":
        """A line over one key, or a heat map over two (the first along the horizontal axis).

        Axes of values that grow by factors are logarithmic, words stand in their order; runs that were not completed
        are marked.

        Args:
            metric: name of a figure of merit.
            ax: axes to draw into; default: a figure of its own.

        Raises:
            UnknownNameError: there is no such figure of merit.
            ConfigurationError: there are more than two keys (`at` takes one away), or none.
        """
        from dualwinch.simulation.plots.sweep import sweep_figure

        return sweep_figure(self, metric, ax=ax)
