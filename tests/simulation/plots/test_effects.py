"""The figure of what numbers change: a panel a column, a line a number, each looking its own way."""

import numpy as np

import dualwinch as dw
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.batch.sensitivities import effects_figure


def test_every_number_has_a_line_of_its_own_in_every_panel() -> None:
    experiment = dw.override(dw.case(4), {"simulation.duration": 0.1})
    keys = [f"key {number}" for number in range(12)]
    changes = {column: {key: np.full(100, 1e-3 * n) for n, key in enumerate(keys)} for column in ("e", "F1")}
    quantities = {"e": Quantity("m", "tracking error"), "F1": Quantity("N", "tension of rope 1")}
    figure = effects_figure(experiment, changes, quantities)
    error, tension = figure.axes
    drawn = [[line for line in axes.lines if len(np.asarray(line.get_xdata())) > 2] for axes in (error, tension)]
    assert [len(lines) for lines in drawn] == [12, 12]
    looks = [[(line.get_color(), line.get_linestyle()) for line in lines] for lines in drawn]
    assert looks[0] == looks[1]
    assert len(set(looks[0])) == 12
    assert np.asarray(drawn[0][5].get_ydata()).tolist() == [5.0] * 100  # mm
    assert np.asarray(drawn[1][5].get_ydata()).tolist() == [5e-3] * 100
    assert error.get_ylabel() == "change of e (mm)"
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == keys
