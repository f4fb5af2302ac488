"""Runs in a figure: none is dropped, each is told apart, whatever they are called."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from matplotlib.colors import same_color, to_hex

from dualwinch import plots
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots.style import BLUE, DASHES, PALETTE
from dualwinch.simulation.results.figures import curves
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SHORT = {"simulation.duration": 0.2}
DRAWN = (plots.trajectory, plots.error, plots.commands, plots.tensions)
GAIN = "controller.observer.l0"


def ran(number: int = 4, kind: str = "fando-nftsm", **values: Any) -> Result:
    return simulate(
        override(case(number, kind), SHORT | {key.replace("__", "."): value for key, value in values.items()})
    )


@pytest.fixture(scope="module")
def two() -> list[Result]:
    """Two runs of one law with different gains."""
    return [simulate(override(case(4), SHORT | {GAIN: gain})) for gain in (5.0, 20.0)]


@pytest.mark.parametrize("draw", DRAWN)
def test_two_runs_of_one_law_are_both_drawn(draw: Callable[..., Any], two: list[Result]) -> None:
    figure = draw({"l0 = 5": two[0], "l0 = 20": two[1]})
    assert [text.get_text() for text in figure.legends[0].get_texts()][:2] == ["l0 = 5", "l0 = 20"]
    for axes in figure.axes[:2]:
        first, second = (
            next(line for line in axes.lines if line.get_label() == name) for name in ("l0 = 5", "l0 = 20")
        )
        assert not same_color(first.get_color(), second.get_color())
        assert first.get_linestyle() != second.get_linestyle()


def test_results_alone_are_labelled_by_their_laws_and_made_distinct(two: list[Result]) -> None:
    nftsm = ran(kind="nftsm")
    assert [run.label for run in curves([*two, nftsm])] == ["FANDO-NFTSM (1)", "FANDO-NFTSM (2)", "NFTSM"]
    assert [run.label for run in curves(nftsm)] == ["NFTSM"]
    assert [run.label for run in curves(iter(two))] == ["FANDO-NFTSM (1)", "FANDO-NFTSM (2)"]
    assert [run.result for run in curves([*two, nftsm])] == [*two, nftsm]


def test_every_law_keeps_its_colour_and_line_style_beside_others_of_its_kind(two: list[Result]) -> None:
    laws = {kind: ran(kind=kind) for kind in POSITION_LAWS}
    drawn = curves({"mine": two[0], "yours": two[1]} | laws)
    for run in drawn[3:]:
        law = run.experiment.controller.law
        assert (run.colour, run.dashes) == (law.colour, law.dashes)
    assert (drawn[0].colour, drawn[0].dashes) == (BLUE, "-")
    assert len({(to_hex(run.colour), str(run.dashes)) for run in drawn}) == len(drawn)
    assert drawn[1].colour not in {law.colour for law in POSITION_LAWS.values()}


def test_many_runs_of_one_law_all_look_different(two: list[Result]) -> None:
    drawn = curves([two[0]] * (len(PALETTE) * len(DASHES)))
    assert len({(run.colour, str(run.dashes)) for run in drawn}) == len(drawn)
    few = drawn[: len(PALETTE)]
    assert len({run.colour for run in few}) == len(few)
    assert len({str(run.dashes) for run in drawn[: len(DASHES)]}) == len(DASHES)
    assert len(curves([two[0]] * (len(drawn) + 3))) == len(drawn) + 3


def test_runs_of_different_cases_share_an_axis_that_holds_them_all() -> None:
    uniform, profile = ran(1), ran(4, simulation__duration=0.4)
    figure = plots.trajectory({"uniform": uniform, "profile": profile})
    position, speed = figure.axes
    assert position.get_xlim() == speed.get_xlim() == (0, 0.4)
    assert [line.get_label() for line in speed.lines] == ["uniform", "profile", "reference", "reference"]
    words = [text.get_text() for text in figure.texts]
    assert "Tracking trajectory" in words
    assert "Uniform speed, no disturbance; profile, vortex shedding" in words


def test_what_is_no_result_is_named() -> None:
    with pytest.raises(ConfigurationError, match=r"^a: a figure draws results of simulate, not dict$"):
        plots.error({"a": {}})  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigurationError, match=r"^results: a figure draws results of simulate, not str$"):
        plots.error(["a"])  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigurationError, match="at least one result"):
        plots.error([])


def test_a_law_without_a_name_or_colour_of_its_own_is_drawn(two: list[Result], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("label", "colour", "dashes"):
        monkeypatch.delattr(Adrc, name)
    unknown = ran(kind="adrc")
    drawn = curves([two[0], unknown])
    assert [run.label for run in drawn] == ["FANDO-NFTSM", "adrc"]
    assert drawn[1].colour != drawn[0].colour
    plots.overview(unknown)


def test_bars_find_the_two_laws_whatever_they_are_called() -> None:
    runs = {"with": ran(), "again": ran(controller__observer__l0=9.0), "without": ran(kind="nftsm")}
    runs = {name: replace(run, metrics=simulate(case(4), stride=0).metrics) for name, run in runs.items()}
    figure = plots.steady_state_bars(runs)
    assert [text.get_text() for text in figure.legends[0].get_texts()][:2] == ["without", "with"]
