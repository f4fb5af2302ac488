"""The page of a figure, its headings, and files of it."""

from collections.abc import Sequence
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, FIGURES, case
from dualwinch.simulation.plots.style import house_style, legend_below, new_figure, time_axis


def case_number(experiment: Experiment) -> int | None:
    """The paper's case whose reference and disturbance an experiment has; ``None`` for another."""
    for number in CASES:
        paper = case(number)
        if (paper.reference, paper.disturbance) == (experiment.reference, experiment.disturbance):
            return number
    return None


def scenario(experiment: Experiment) -> str:
    """Reference and disturbances in words."""
    number = case_number(experiment)
    if number is not None:
        return CASES[number]
    disturbance = experiment.disturbance
    sources = {
        "vortex shedding": disturbance.vortex,
        "current": disturbance.current_sigma > 0 or disturbance.current.given,
        "varying rail load": disturbance.normal_force_sigma > 0 or disturbance.normal_force_variation.given,
        "given force": disturbance.force.given,
    }
    words = [name for name, present in sources.items() if present]
    reference = {"uniform": "uniform speed", "file": "recorded motion"}
    return ", ".join(
        [reference.get(experiment.reference.kind, experiment.reference.kind), *(words or ["no disturbance"])]
    )


def headings(experiments: Sequence[Experiment], content: str, words: str) -> tuple[str, str]:
    """Title and subtitle of a figure of runs; the paper's number of the figure where all are of one of its cases.

    Args:
        experiments: what was run.
        content: one of `simulation.paper.CONTENTS`.
        words: what is drawn, for the title.
    """
    numbers = {case_number(experiment) for experiment in experiments}
    shown = [figure for figure in FIGURES if {figure.case} == numbers and figure.content == content]
    title = words[0].upper() + words[1:]
    for figure in shown:
        title = f"Figure {figure.number} · Case {figure.case}: {words}"
    scenarios = dict.fromkeys(map(scenario, experiments))
    return title, "; ".join(scenarios).capitalize()


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


RESOLUTION = 200
"""Dots per inch of a PNG."""

METADATA = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
"""Suffix → what to keep out of the file: anything that changes from day to day or machine to machine."""


def encode(figure: Figure, suffix: str) -> bytes:
    """A figure as the content of a file.

    Args:
        figure: what to write.
        suffix: ``.png`` (200 dots per inch), ``.svg`` or ``.pdf``.

    Raises:
        ConfigurationError: another suffix.
    """
    form = suffix.lower()
    if form not in METADATA:
        raise ConfigurationError(f"unknown suffix {suffix!r}; must be one of {', '.join(METADATA)}")
    stream = BytesIO()
    with house_style():
        figure.savefig(stream, format=form.removeprefix("."), dpi=RESOLUTION, metadata=METADATA[form])
    return stream.getvalue()


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Write a figure to a file, which appears whole or not at all.

    Args:
        figure: what to write.
        path: its suffix chooses the format: png, svg, pdf.

    Raises:
        ConfigurationError: another suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    content = encode(figure, path.suffix)
    with atomic(path) as unfinished:
        unfinished.write_bytes(content)
