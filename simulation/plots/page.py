"""Where a figure is drawn: on a page of its own, or into the axes of a caller's figure."""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.style import legend_below, new_figure, time_axis

GivenAxes: TypeAlias = Axes | Sequence[Axes] | NDArray[Any] | None
"""Argument `ax` of a figure: axes to draw its panels into, in their order; where there are fewer, only the first panels
are drawn. ``None``: a figure of its own."""


class Page:
    """A new figure with heading, panels and a legend below them, or a caller's axes, with the legend in the first."""

    def __init__(self, ax: GivenAxes, height: float, title: str, subtitle: str, gap: float = 0.05) -> None:
        """Set the page up.

        Args:
            ax: a caller's axes, which get neither title nor subtitle.
            height: of a new figure, in inches.
            title: its first line.
            subtitle: its second line.
            gap: half the vertical space between two of its panels, in inches.

        Raises:
            ConfigurationError: `ax` holds something else than axes, or nothing.
        """
        self._given = None if ax is None else _checked(ax)
        self.figure = new_figure(height, title, subtitle, gap) if self._given is None else _root(self._given[0])
        self._panels: list[Axes] = []

    def panels(self, rows: int, columns: int = 1, order: Literal["C", "F"] = "F", **layout: Any) -> list[Axes]:
        """The panels of a grid, column by column (`order` "C": row by row); `layout` as for `Figure.subplots`."""
        if self._given is not None:
            return self._limited(rows * columns)
        grid = self.figure.subplots(rows, columns, squeeze=False, **layout)
        self._panels = list(grid.ravel(order))
        return self._panels

    def mosaic(self, names: list[list[str]], **layout: Any) -> list[Axes]:
        """The panels of a mosaic in the order of their names; `layout` as for `Figure.subplot_mosaic`."""
        known = list(dict.fromkeys(name for row in names for name in row))
        if self._given is not None:
            return self._limited(len(known))
        layout |= {"mosaic": names}
        found = self.figure.subplot_mosaic(**layout)
        self._panels = [found[name] for name in known]
        return self._panels

    def time_axes(self, panels: Sequence[Axes], experiment: Experiment) -> None:
        """Limit panels above each other to the run's duration in s; name the lowest's axis, and each of a caller's."""
        for axes in panels:
            time_axis(axes, experiment, named=self._given is not None or axes is panels[-1])

    def align(self) -> None:
        """Put the names of the panels' vertical axes below each other."""
        self.figure.align_ylabels(self._panels)

    def legend(self, handles: Sequence[Line2D | Patch]) -> None:
        """One legend for all panels, where it covers nothing; in a caller's axes inside the first."""
        if self._given is None:
            legend_below(self.figure, [*handles])
        else:
            self._given[0].legend(handles=[*handles])

    def _limited(self, count: int) -> list[Axes]:
        given = self._given or []
        if len(given) > count:
            raise ConfigurationError(f"ax: {len(given)} axes were given; there are {count} panels")
        self._panels = given
        return given


def _checked(ax: Axes | Sequence[Axes] | NDArray[Any]) -> list[Axes]:
    given = [ax] if isinstance(ax, Axes) else list(np.ravel(np.asarray(ax, dtype=object)))
    if not given or not all(isinstance(axes, Axes) for axes in given):
        raise ConfigurationError("ax: must be matplotlib axes, or a list or array of them")
    return given


def _root(axes: Axes) -> Figure:
    figure = axes.figure
    return figure.figure if isinstance(figure, SubFigure) else figure
