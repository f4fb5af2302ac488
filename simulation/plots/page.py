"""Layout of a figure's page with headings and legend, and its files."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, case
from dualwinch.simulation.plots.style import GREY, LIGHT, SHADE, house_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch


def case_number(experiment: Experiment) -> int | None:
    """Number of the paper's case with the reference and disturbance of an experiment; ``None`` for any other."""
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


WIDTH = 7.0
"""Width of every figure in inches: a page, or half a screen."""

LEGEND_WIDTH, LEGEND_HANDLE = 105, 7
"""Width of a legend below a figure in characters, and that of its line samples."""

GivenAxes: TypeAlias = "Axes | Sequence[Axes] | NDArray[Any] | None"
"""Argument `ax` of a figure: axes for its panels, in their order; with fewer axes, only the first panels are drawn.
``None``: a figure of its own."""


@contextmanager
def new_page(ax: GivenAxes, height: float, title: str, subtitle: str, gap: float = 0.05) -> Iterator["Page"]:
    """The page of a figure, drawn in the house style; axis labels are aligned at the end.

    Args:
        ax: a caller's axes, which get neither title nor subtitle.
        height: height of a new figure in inches.
        title: its first line.
        subtitle: its second line.
        gap: half the vertical space between two of its panels, in inches.

    Raises:
        ConfigurationError: `ax` contains anything but axes, or nothing.
    """
    with house_style():
        page = Page(_new_figure(height, title, subtitle, gap)) if ax is None else _page_of(ax)
        yield page
        page.figure.align_ylabels([axes for axes in page.drawn if axes.get_ylabel()])


def _new_figure(height: float, title: str, subtitle: str, gap: float) -> "Figure":
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = ConstrainedLayoutEngine(w_pad=0.06, h_pad=gap, hspace=0.04, wspace=0.03)
    figure = Figure(figsize=(WIDTH, height), layout=engine)
    margin = 0.06 / WIDTH
    # an invisible suptitle of two lines reserves the space of the heading, which is drawn over it in two weights
    figure.suptitle(" \n ", x=margin, ha="left", fontsize=10, linespacing=1.35)
    figure.text(margin, 1 - 0.06 / height, title, ha="left", va="top", fontsize=10.5, fontweight="bold")
    figure.text(margin, 1 - 0.25 / height, subtitle, ha="left", va="top", fontsize=8.5, color=GREY)
    return figure


def _page_of(ax: "Axes | Sequence[Axes] | NDArray[Any]") -> "Page":
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

    axes_list = [ax] if isinstance(ax, Axes) else list(np.ravel(np.asarray(ax, dtype=object)))
    if not axes_list or not all(isinstance(axes, Axes) for axes in axes_list):
        raise ConfigurationError("ax: must be matplotlib axes, or a list or array of them")
    figure = axes_list[0].figure
    return Page(figure.figure if isinstance(figure, SubFigure) else figure, axes_list)


class Page:
    """A new figure with heading, panels and a legend below them, or a caller's axes, with the legend in the first.

    Attributes:
        figure: the figure.
        drawn: the visible panels: all, or the caller's axes.
    """

    def __init__(self, figure: "Figure", given: "list[Axes] | None" = None) -> None:
        self.figure, self._given = figure, given
        self.drawn: list[Axes] = given or []

    def panels(self, rows: int = 1, columns: int = 1, order: Literal["C", "F"] = "F", **layout: Any) -> "list[Axes]":
        """The panels of a grid, column by column (`order` "C": row by row); `layout` as for `Figure.subplots`.

        Panels without axes of the caller are drawn into a figure that is discarded.
        """
        if self._given is None:
            self.drawn = list(self.figure.subplots(rows, columns, squeeze=False, **layout).ravel(order))
            return self.drawn
        return self._with_others(rows * columns)

    def mosaic(self, names: list[list[str]], **layout: Any) -> "list[Axes]":
        """The panels of a mosaic in the order of their names; `layout` as for `Figure.subplot_mosaic`."""
        panel_names = list(dict.fromkeys(name for row in names for name in row))
        if self._given is None:
            layout |= {"mosaic": names}
            panels = self.figure.subplot_mosaic(**layout)
            self.drawn = [panels[name] for name in panel_names]
            return self.drawn
        return self._with_others(len(panel_names))

    def _with_others(self, count: int) -> "list[Axes]":
        from matplotlib.figure import Figure

        shortfall = count - len(self.drawn)
        if shortfall < 0:
            raise ConfigurationError(f"ax: {len(self.drawn)} axes were given; there are {count} panels")
        return [*self.drawn, *(Figure().subplots() for _ in range(shortfall))]

    def time_axes(self, panels: "Sequence[Axes]", experiment: Experiment, *, shaded: bool = True) -> None:
        """Limit stacked panels to the run's duration in s, shade its steady state, and label their time axis."""
        start, end = experiment.steady_window
        for axes in panels:
            if shaded:
                axes.axvspan(start, min(end, experiment.duration), color=SHADE, linewidth=0, zorder=0)
            axes.set_xlim(0, experiment.duration)
        self.name_x(panels, "time (s)")

    def name_x(self, panels: "Sequence[Axes]", name: str) -> None:
        """Label the horizontal axis of stacked panels: only the lowest, or each of a caller's axes."""
        for axes in panels if self._given else panels[-1:]:
            axes.set_xlabel(name)

    def legend(self, *others: "Line2D | Patch") -> None:
        """One legend for all panels, with `others` last: below them, or inside the first of a caller's axes."""
        handle_by_label: dict[str, Any] = {}
        for axes in self.drawn:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                handle_by_label.setdefault(label, handle)
        handles = [*handle_by_label.values(), *others]
        if self._given and handles:
            self._given[0].legend(handles=handles)
        elif handles:
            widths = [len(str(handle.get_label())) + LEGEND_HANDLE for handle in handles]
            rows = -(-sum(widths) // LEGEND_WIDTH)
            columns = min(-(-len(handles) // rows), max(LEGEND_WIDTH // max(widths), 1))  # as the widest fit
            placed = {"loc": "outside lower center", "handlelength": 2.6, "columnspacing": 1.6}
            self.figure.legend(handles=handles, ncols=columns, **placed)


def steady_patch() -> "Patch":
    """Legend entry of the shaded steady-state window."""
    from matplotlib.patches import Patch

    return Patch(facecolor=SHADE, edgecolor=LIGHT, linewidth=1.0, label="steady state")


METADATA = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
"""Suffix → metadata left out of the file, as they vary with date or machine."""


def encode(figure: "Figure", suffix: str) -> bytes:
    """A figure as the content of a file.

    Args:
        figure: the figure.
        suffix: ``.png`` (200 dots per inch), ``.svg`` or ``.pdf``.

    Raises:
        ConfigurationError: another suffix.
    """
    form = suffix.lower()
    if form not in METADATA:
        raise ConfigurationError(f"unknown suffix {suffix!r}; must be one of {', '.join(METADATA)}")
    stream = BytesIO()
    with house_style():
        figure.savefig(stream, format=form.removeprefix("."), metadata=METADATA[form])
    return stream.getvalue()


def save(figure: "Figure", path: str | PathLike[str]) -> None:
    """Write a figure to a file, which appears whole or not at all.

    Args:
        figure: the figure.
        path: file; its suffix selects the format: png, svg, pdf.

    Raises:
        ConfigurationError: another suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    content = encode(figure, path.suffix)
    with atomic(path) as unfinished:
        unfinished.write_bytes(content)
