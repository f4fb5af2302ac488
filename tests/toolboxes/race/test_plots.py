"""Figures of a race show its numbers."""

from dataclasses import replace

import numpy as np
import pytest

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


def test_fronts_leave_out_what_breaks_a_constraint_or_is_beaten() -> None:
    chatter, load = FOUND.plot_fronts().axes
    assert (chatter.get_xlabel(), load.get_xlabel()) == ("mean chatter (N)", "mean continuous load (N m)")
    lines = [line for line in chatter.lines if line.get_linestyle() != "None" and line.get_marker() == "."]
    adrc = next(line for line in lines if np.ravel(line.get_ydata())[0] == pytest.approx(1e3 * 4e-7**0.5))
    assert np.ravel(adrc.get_xdata()).tolist() == [1.0, 2.0], "a point that satisfies all constraints, and the best"
    infeasible = next(line for line in lines if np.ravel(line.get_ydata())[0] == pytest.approx(1e3 * 2e-6**0.5))
    assert np.ravel(infeasible.get_xdata()).tolist() == [1.0], "its best violates a constraint"


def test_nobody_who_finished_a_scenario_is_no_error() -> None:
    lost = replace(FOUND, entries=(scored("super-twisting", 1.0, lost=40), *FOUND.entries))
    assert len([line for line in lost.plot().axes[0].lines if line.get_marker() == "o"]) == 4
    lost.plot_fronts()
