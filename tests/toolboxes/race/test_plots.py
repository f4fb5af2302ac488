"""Figures of a race show its numbers."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from dualwinch.toolboxes.race.result import end_of_marks
from tests.toolboxes.race.made_up import made_up, scored

FOUND = made_up()


def test_dots_are_the_ratios_the_best_first_and_hollow_where_a_constraint_is_broken() -> None:
    axes = FOUND.plot().axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        FOUND.names[each.entry.key] for each in FOUND.ranking
    ]
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    spans = [line for line in axes.lines if line.get_marker() == "None" and len(np.ravel(line.get_xdata())) == 2]
    for row, (dot, span, entry) in enumerate(zip(dots, spans, FOUND.ranking, strict=False)):
        interval = FOUND.ratios[entry.entry.key].interval
        assert np.ravel(dot.get_xydata()).tolist() == pytest.approx([interval.estimate, row])
        assert np.ravel(span.get_xdata()).tolist() == pytest.approx([interval.low, interval.high])
        assert (dot.get_markerfacecolor() == "white") is bool(entry.runs.violated)
    assert len(dots) == 4
    assert len({dots[0].get_color(), dots[1].get_color()}) == 1 != len({dots[0].get_color(), dots[2].get_color()})
    assert axes.get_xscale() == "log"


def test_the_number_stands_beside_its_dot_where_a_search_is_far_off() -> None:
    first = FOUND.ranking[0]
    key, group = first.entry.key, first.entry.group
    axes = FOUND.plot().axes[0]
    high = FOUND.ratios[key].interval.high
    label = next(text for text in axes.texts if text.xy[1] == 0)  # pyright: ignore[reportAttributeAccessIssue]
    near = [FOUND.ratios[each.entry.key].interval.estimate for each in FOUND.searches[group]]
    assert label.xy[0] == pytest.approx(max(high, *near))  # pyright: ignore[reportAttributeAccessIssue]
    assert end_of_marks(1e-4, [9e-5, 2e-4, 1e-3, 40.0]) == 1e-3
    assert end_of_marks(1e-4, [9e-5, 40.0]) == 1e-4


def test_fronts_leave_out_what_breaks_a_constraint_or_is_beaten() -> None:
    chatter, load = FOUND.plot_fronts().axes
    assert (chatter.get_xlabel(), load.get_xlabel()) == ("mean chatter (N)", "mean continuous load (N m)")
    lines = [line for line in chatter.lines if line.get_linestyle() != "None" and line.get_marker() == "."]
    adrc = next(line for line in lines if np.ravel(line.get_ydata())[0] == pytest.approx(1e3 * 4e-7**0.5))
    assert np.ravel(adrc.get_xdata()).tolist() == [1.0, 2.0], "a point that satisfies all constraints, and the best"
    infeasible = next(line for line in lines if np.ravel(line.get_ydata())[0] == pytest.approx(1e3 * 2e-6**0.5))
    assert np.ravel(infeasible.get_xdata()).tolist() == [1.0], "its best violates a constraint"


def test_a_least_error_is_drawn_where_it_is_near() -> None:
    def names(least: float, foreseeing: float) -> set[str]:
        figure = made_up(least, foreseeing).plot_fronts()
        return {text.get_text() for text in figure.legends[0].get_texts()}

    assert {"least error without foresight", "with foresight"} <= names(4e-8, 1e-8)
    assert "with foresight" not in names(4e-8, 0.0)
    assert "least error without foresight" not in names(1e-14, 0.0)


def test_nobody_who_finished_a_scenario_is_no_error() -> None:
    lost = replace(FOUND, entries=(scored("super-twisting", 1.0, lost=40), *FOUND.entries))
    assert len([line for line in lost.plot().axes[0].lines if line.get_marker() == "o"]) == 4
    lost.plot_fronts()


def test_axes_of_ones_own() -> None:
    figure = Figure()
    axes = figure.subplots(1, 2)
    assert FOUND.plot_fronts(ax=axes) is figure
    assert len(axes[1].lines) > 4


def test_every_search_has_a_tick() -> None:
    adrc = next(each for each in FOUND.entries if each.entry.law == "adrc")
    again = replace(scored("adrc", 0.2), entry=replace(adrc.entry, search=1))
    axes = replace(FOUND, entries=(*FOUND.entries, again)).plot().axes[0]
    (ticks,) = (line for line in axes.lines if line.get_marker() == "|")
    assert np.ravel(ticks.get_xdata()).tolist() == pytest.approx([0.1, 0.2], rel=0.1)
    assert len([line for line in axes.lines if line.get_marker() == "o"]) == 4
