"""Figures of sweeps: a line over one key, a heat map over two."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.quantity import Quantity, nearest
from dualwinch.model.quantities.tables import readable, readable_unit
from dualwinch.simulation.batch.rollout import RunGrid
from dualwinch.simulation.plots.page import GivenAxes, Page, scenario
from dualwinch.simulation.plots.style import BLUE, INK, LIGHT, VERMILION, house_style, law_label

Floats = NDArray[np.float64]

SPAN = 10
"""Numbers whose largest is fewer times the smallest lie evenly."""

LABELLED = 9
"""Most numbers that each have a tick of their own."""


@dataclass(frozen=True)
class SweptAxis:
    """An axis.

    Attributes:
        order: indices of the values along the axis.
        positions: (n,) of the values in that order.
        words: what stands at each; empty where the axis has numbers of its own.
        log: whether factors count, not differences.
        categorical: whether what lies in between means nothing.
    """

    order: NDArray[np.int64]
    positions: Floats
    words: tuple[str, ...]
    log: bool
    categorical: bool = False

    @property
    def edges(self) -> Floats:
        """(n + 1,) ends of the cells around the values."""
        at = np.log(self.positions) if self.log else self.positions
        if len(at) == 1:
            half = 0.5 * (abs(at[0]) or 1.0)
            inner, first, last = np.empty(0), at[0] - half, at[0] + half
        else:
            inner = (at[1:] + at[:-1]) / 2
            first, last = 2 * at[0] - inner[0], 2 * at[-1] - inner[-1]
        edges = np.concatenate(([first], inner, [last]))
        return np.exp(edges) if self.log else edges

    def draw(self, axes: Axes, side: Literal["x", "y"], label: str) -> None:
        """Set scale, ticks and label of one of a panel's axes."""
        axes.set(**{f"{side}label": label} | ({f"{side}scale": "log"} if self.log else {}))
        axis = axes.xaxis if side == "x" else axes.yaxis
        if self.words:
            axis.set_ticks(self.positions.tolist(), self.words)
            axis.set_minor_locator(NullLocator())


def swept_axis(values: Sequence[Any]) -> SweptAxis:
    """The axis of a key's values."""
    if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        words = tuple("–" if value is None else str(value).lower() for value in values)
        order = np.arange(len(values))
        return SweptAxis(order, order.astype(float), words, log=False, categorical=True)
    order = np.argsort(values)
    positions = np.array(values, float)[order]
    words = tuple(f"{value:.4g}" for value in positions) if len(positions) <= LABELLED else ()
    return SweptAxis(order, positions, words, log=grows_by_factors(positions))


def grows_by_factors(ascending: Floats) -> bool:
    """Whether the steps between numbers are more even as factors than as differences."""
    if len(ascending) < 3 or ascending[0] <= 0 or ascending[-1] < SPAN * ascending[0]:
        return False
    factors, differences = np.diff(np.log(ascending)), np.diff(ascending)
    return bool(np.ptp(factors) / factors.mean() < np.ptp(differences) / differences.mean())


def spans_decades(values: Floats) -> bool:
    """Whether measured values, NaN among them, are told apart on a logarithmic scale only."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() >= 3 * SPAN * finite.min())


MARKS = {"diverged": "x", "left_track": ">", "not_run": "."}
"""Outcome of a run that was not completed → its marker."""

WRITTEN = 60
"""Most cells that have their numbers written in them."""


def sweep_figure(found: RunGrid, metric: str, *, ax: GivenAxes = None) -> Figure:
    """Draw a sweep; see `Sweep.plot`.

    Raises:
        UnknownNameError: there is no such figure of merit.
        ConfigurationError: there are more than two keys, or none.
    """
    if metric not in found.metrics:
        raise UnknownNameError(f"unknown metric {metric!r}; did you mean '{nearest(str(metric), found.metrics)}'?")
    if len(found.keys) not in {1, 2}:
        raise ConfigurationError(f"a sweep of {len(found.keys)} keys cannot be drawn; at(key, value) takes one away")
    axes_of = [swept_axis(values) for values in found.values]
    merit = found.merits[metric]
    title = f"{metric} over {' and '.join(key.rsplit('.', 1)[-1] for key in found.keys)}"
    law = "" if "controller.kind" in found.keys else f"{law_label(found.experiment)}; "
    with house_style():
        page = Page(ax, 3.2 if len(found.keys) == 1 else 3.8, title, law + scenario(found.experiment))
        (axes,) = page.panels(1)
        draw = _line if len(found.keys) == 1 else _map
        values, outcomes = found.metrics[metric], found.outcomes
        for dimension, axis in enumerate(axes_of):
            values, outcomes = values.take(axis.order, dimension), outcomes.take(axis.order, dimension)
        draw(axes, axes_of, values, outcomes, _named(metric, merit))
        axes.set_title(readable(merit.meaning))
        sides: tuple[Literal["x", "y"], ...] = ("x", "y")
        for key, axis, side in zip(found.keys, axes_of, sides, strict=False):
            axis.draw(axes, side, _named(key, found.quantities[key]))
        handles = [
            Line2D([], [], color=VERMILION, marker=marker, linestyle="none", label=outcome.replace("_", " "))
            for outcome, marker in MARKS.items()
            if (found.outcomes == outcome).any()
        ]
        if handles:
            page.legend(handles)
    return page.figure


def _line(axes: Axes, along: list[SweptAxis], values: Floats, outcomes: NDArray[np.str_], name: str) -> None:
    (axis,) = along
    line = "none" if axis.categorical else "-"
    axes.plot(axis.positions, values, marker="o", markersize=4, linestyle=line, color=BLUE)
    for outcome, marker in MARKS.items():
        ended = axis.positions[outcomes == outcome]
        axes.plot(
            ended,
            np.full(len(ended), 0.04),
            transform=axes.get_xaxis_transform(),
            marker=marker,
            linestyle="none",
            color=VERMILION,
            clip_on=False,
        )
    if spans_decades(values):
        axes.set_yscale("log")
    axes.set_ylabel(name)
    if axis.categorical:
        axes.set_xlim(-0.5, len(axis.positions) - 0.5)


def _map(axes: Axes, along: list[SweptAxis], values: Floats, outcomes: NDArray[np.str_], name: str) -> None:
    across, up = along
    axes.grid(visible=False)
    axes.set_facecolor(LIGHT)
    if np.isfinite(values).any():
        lowest, highest = np.nanmin(values), np.nanmax(values)
        scale = (LogNorm if spans_decades(values) else Normalize)(lowest, highest)
        cells = axes.pcolormesh(across.edges, up.edges, values.T, norm=scale, cmap="viridis")
        bar = axes.figure.colorbar(cells, ax=axes, label=name)
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]  # the stub has no Spine here
        if values.size <= WRITTEN:
            for i, j in zip(*np.nonzero(np.isfinite(values)), strict=True):
                at = float(across.positions[i]), float(up.positions[j])
                colour = "white" if scale(values[i, j]) < 0.6 else INK
                axes.text(*at, f"{values[i, j]:.3g}", ha="center", va="center", color=colour, size=7)
    for outcome, marker in MARKS.items():
        i, j = np.nonzero(outcomes == outcome)
        axes.plot(across.positions[i], up.positions[j], marker=marker, linestyle="none", color=VERMILION)
    axes.set_xlim(across.edges[[0, -1]].tolist())
    axes.set_ylim(up.edges[[0, -1]].tolist())


def _named(words: str, quantity: Quantity) -> str:
    unit = readable_unit(quantity.unit)
    return f"{words} ({unit})" if unit else words
