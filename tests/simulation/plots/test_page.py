"""Figures in the axes of a caller's figure."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dualwinch import plots
from dualwinch.analysis.describing_function import amplitude_sweep
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.analysis.plots.linear import (
    amplitude_margins,
    bode,
    closed_loop_poles,
    loop_bode,
    modal_frequencies,
    mode_shapes,
    pole_map,
)
from dualwinch.analysis.stability import certify
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.simulation.ensembles.comparison import compare
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots.style import house_style
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.plant_points import linearise, linearise_sweep
from tests.tiers import all_but

Draw = Callable[..., Figure]

SHORT = override(case(4), {"simulation.duration": 0.2})
SEA = reset(load_ensemble("sea"), {"simulation.duration": 0.2})


def runs() -> dict[str, Any]:
    return {"a": simulate(SHORT), "b": simulate(override(SHORT, {"controller.observer.l0": 9.0}))}


def pair() -> dict[str, Any]:
    metrics = simulate(case(4), stride=0).metrics
    found = {kind: simulate(override(SHORT, {"controller.kind": kind})) for kind in ("fando-nftsm", "nftsm")}
    return {kind: replace(run, metrics=metrics) for kind, run in found.items()}


def sweep() -> tuple[Any, ...]:
    return linearise_sweep([5.0, 25.0, 40.0]), "x", Plant()


def opened() -> tuple[Any, ...]:
    system = linear_open_loop(case(4), 25.0, 0.5, "u")
    return [system], [margins(system)]


def compared() -> Any:
    controllers = {"a": case(4).controller, "b": case(4, "nftsm").controller}
    return compare(controllers, SEA, 3, 0)


FIGURES: dict[str, tuple[Draw, Callable[[], tuple[Any, ...]], int]] = {
    "trajectory": (plots.trajectory, lambda: (runs(),), 2),
    "error": (plots.error, lambda: (runs(),), 3),
    "commands": (plots.commands, lambda: (runs(),), 2),
    "tensions": (plots.tensions, lambda: ({"a": simulate(override(case(1), {"simulation.duration": 0.2}))},), 4),
    "bars": (plots.steady_state_bars, lambda: (pair(),), 4),
    "overview": (plots.overview, lambda: (simulate(SHORT),), 5),
    "lyapunov": (plots.lyapunov, lambda: (certify(SHORT),), 2),
    "fan chart": (plots.fan_chart, lambda: (run_ensemble(SEA, 3, 0),), 3),
    "comparison": (plots.comparison, lambda: (compared(),), 3),
    "bode": (bode, lambda: ([linearise()],), 6),
    "mode shapes": (mode_shapes, lambda: (linearise(), Plant()), 4),
    "modal frequencies": (modal_frequencies, lambda: (*sweep(), 1e-3), 2),
    "pole map": (pole_map, sweep, 2),
    "loop bode": (loop_bode, opened, 2),
    "closed-loop poles": (closed_loop_poles, lambda: ([linear_closed_loop(case(4), 25.0, 0.5)],), 2),
    "amplitude": (amplitude_margins, lambda: (amplitude_sweep(case(4), 25.0, 0.5, "u", (1e-4, 1e-3)),), 2),
}
"""Figure → what draws it, its arguments, its number of panels."""


@cache
def arguments_of(name: str) -> tuple[Any, ...]:
    """What a figure is drawn of, which no figure changes."""
    return FIGURES[name][1]()


def content(axes: Axes) -> tuple[str, str, int, int, int]:
    """What tells a panel from another, and whether anything is missing in it."""
    return axes.get_title("left"), axes.get_ylabel(), len(axes.lines), len(axes.collections), len(axes.patches)


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_draws_into_given_axes(name: str) -> None:
    draw, _, count = FIGURES[name]
    given = arguments_of(name)
    own = draw(*given)
    mine = Figure(figsize=(5 * count, 4))
    axes = list(mine.subplots(1, count, squeeze=False)[0])
    assert draw(*given, ax=axes) is mine
    assert not mine.texts, "a heading of its own"
    panels = [panel for panel in own.axes if panel.get_label() != "<colorbar>"]
    assert sorted(map(content, panels)) == sorted(map(content, axes))
    plots.encode(mine, ".png")


@pytest.mark.parametrize("name", all_but([*FIGURES][::4], FIGURES))
def test_fewer_axes_get_the_first_panels(name: str) -> None:
    draw, _, count = FIGURES[name]
    mine = Figure()
    axes = mine.subplots()
    given = arguments_of(name)
    assert draw(*given, ax=axes) is mine
    assert axes.has_data()
    plots.encode(mine, ".png")
    with pytest.raises(ConfigurationError, match=rf"^ax: {count + 1} axes were given; there are {count} panels$"):
        draw(*given, ax=Figure().subplots(count + 1))


def test_the_legend_stands_in_the_first_of_given_axes() -> None:
    first, second = Figure().subplots(2)
    plots.trajectory(runs(), ax=np.array([first, second]))
    legend = first.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["a", "b", "reference", "steady state"]
    assert second.get_legend() is None
    assert first.get_xlabel() == second.get_xlabel() == "time (s)"


@pytest.mark.parametrize("wrong", [3, "axes", [], [None], Figure()])
def test_what_are_no_axes_is_refused(wrong: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"^ax: must be matplotlib axes, or a list or array of them$"):
        plots.error(runs(), ax=wrong)


def test_logarithmic_axes_within_a_decade_say_plain_numbers() -> None:
    with house_style():
        figure = Figure()
        axes = figure.subplots()
        axes.plot([1, 2], [4.0, 9.0])
        axes.set_yscale("log")
    plots.encode(figure, ".svg")
    with house_style():
        axis = axes.yaxis
        labels = [axis.get_minor_formatter()(tick) for tick in axis.get_minorticklocs()]
    assert "$\\mathdefault{6}$" in labels
    assert not [label for label in labels if "times" in label]
