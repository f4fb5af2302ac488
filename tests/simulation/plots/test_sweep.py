"""Figures of made-up sweeps, whose numbers are known."""

from typing import Any

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots.page import encode
from dualwinch.simulation.sweep import Sweep, swept_axis

GAIN, LAW = "controller.observer.l0", "controller.kind"
QUANTITIES = {GAIN: Quantity("1/s", "gain"), LAW: Quantity("", "law")}


def made(values: dict[str, list[Any]], mse: Any, failed: dict[tuple[int, ...], str] | None = None) -> Sweep:
    metric = np.array(mse, float)
    outcomes = np.full(metric.shape, "completed", dtype="U10")
    for index, outcome in (failed or {}).items():
        metric[index], outcomes[index] = np.nan, outcome
    return Sweep(
        outcomes=outcomes,
        end_times=np.full(metric.shape, 50.0),
        metrics={"mse": metric},
        interrupted=False,
        experiment=case(4),
        keys=tuple(values),
        values=tuple(map(tuple, values.values())),
        quantities=QUANTITIES,
    )


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def test_a_line_over_numbers_is_sorted_and_logarithmic_where_factors_count() -> None:
    figure = made({GAIN: [100, 1, 10]}, [3.0, 1e-3, 2.0]).plot("mse")
    axes = figure.axes[0]
    x, y = map(np.asarray, axes.lines[0].get_data())
    assert (x.tolist(), y.tolist()) == ([1, 10, 100], [1e-3, 2.0, 3.0])
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert (axes.get_xlabel(), axes.get_ylabel()) == (f"{GAIN} (1/s)", "mse (m²)")
    assert axes.get_title("left") == "mean e², whole run"
    assert encode(figure, ".png")


def test_even_steps_lie_evenly() -> None:
    axes = made({GAIN: [0, 50, 100]}, [1.0, 2.0, 3.0]).plot("mse").axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")


def test_words_stand_in_their_order_without_a_line() -> None:
    axes = made({LAW: ["nftsm", "adrc"]}, [1.0, 2.0]).plot("mse").axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["nftsm", "adrc"]
    assert axes.lines[0].get_linestyle() == "None"
    assert axes.get_xlabel() == LAW


def test_runs_that_were_not_completed_are_marked_and_named() -> None:
    found = made({GAIN: [1, 2, 3]}, [1.0, 1.0, 1.0], {(1,): "diverged", (2,): "not_run"})
    figure = found.plot("mse")
    marks = {line.get_marker(): np.asarray(line.get_xdata()).tolist() for line in figure.axes[0].lines[1:]}
    assert marks == {"x": [2], ">": [], ".": [3]}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["diverged", "not run"]


def test_a_heat_map_has_every_cell_at_its_values() -> None:
    mse = [[1e-4, 1e-2, 1.0], [2e-4, 2e-2, 2.0]]
    found = made({LAW: ["nftsm", "adrc"], GAIN: [10, 1, 100]}, mse, {(1, 2): "left_track"})
    figure = found.plot("mse")
    axes, bar = figure.axes
    (cells,) = [item for item in axes.collections if isinstance(item, QuadMesh)]
    drawn = np.ma.filled(np.ma.asarray(cells.get_array()), np.nan)
    assert np.array_equal(drawn, [[1e-2, 2e-2], [1e-4, 2e-4], [1.0, np.nan]], equal_nan=True)
    corners = np.asarray(cells.get_coordinates())
    assert corners[0, :, 0] == pytest.approx([-0.5, 0.5, 1.5])
    assert corners[:, 0, 1] == pytest.approx(10.0 ** np.array([-0.5, 0.5, 1.5, 2.5]))
    assert isinstance(cells.norm, LogNorm)
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    assert bar.get_ylabel() == "mse (m²)"
    assert sorted(texts(figure)) == sorted(["0.01", "0.02", "0.0001", "0.0002", "1"])
    left = next(line for line in axes.lines if line.get_marker() == ">")
    assert [np.asarray(data).tolist() for data in left.get_data()] == [[1], [100]]
    assert encode(figure, ".svg")


def test_a_map_of_nothing_but_failures_is_drawn() -> None:
    found = made({LAW: ["nftsm"], GAIN: [1, 2]}, [[1.0, 1.0]], {(0, 0): "diverged", (0, 1): "diverged"})
    assert encode(found.plot("mse"), ".png")


def test_it_draws_into_given_axes() -> None:
    figure = Figure()
    axes = figure.subplots()
    assert made({GAIN: [1, 2]}, [1.0, 2.0]).plot("mse", ax=axes) is figure
    assert axes.lines


def test_what_cannot_be_drawn_is_told() -> None:
    with pytest.raises(UnknownNameError, match=r"^unknown metric 'msee'; did you mean 'mse'\?"):
        made({GAIN: [1]}, [1.0]).plot("msee")
    three = made({GAIN: [1], LAW: ["nftsm"], "x": [1]}, [[[1.0]]])
    with pytest.raises(ConfigurationError, match=r"^a sweep of 3 keys cannot be drawn; at\(key, value\) removes one"):
        three.plot("mse")


@pytest.mark.parametrize(
    ("values", "log"),
    [
        ([1, 10, 100], True),
        ([1, 2, 5, 10, 20, 50], True),
        ([10, 20, 100], True),
        ([1, 2, 3], False),
        ([0, 10, 100], False),
        ([-1, 10, 100], False),
        ([*range(1, 65)], False),
        ([1, 100], False),
    ],
)
def test_what_grows_by_factors(values: list[float], log: bool) -> None:
    assert swept_axis(values).log is log


def test_a_single_value_has_a_cell() -> None:
    assert swept_axis([4.0]).edges.tolist() == [2.0, 6.0]
    assert swept_axis([0.0]).edges.tolist() == [-0.5, 0.5]
    assert swept_axis([True, False]).words == ("true", "false")
    assert swept_axis([None, 2.0]).words == ("–", "2.0")
