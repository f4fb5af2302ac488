import numpy as np
import pytest
from matplotlib.figure import Figure

from dualwinch.analysis.describing_function import amplitude_sweep
from dualwinch.analysis.linear_loop import linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.analysis.plots.linear import (
    amplitude_margins,
    bode,
    loop_bode,
    modal_frequencies,
    mode_shapes,
    pole_map,
)
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from tests.plant_points import linearise, linearise_sweep

X = np.arange(0.0, 51.0, 5.0)


@pytest.fixture(scope="module")
def sweep() -> list[LinearSystem]:
    return linearise_sweep(X, 1.8)


def titles(figure: Figure, loc: str = "left") -> list[str]:
    return [axes.get_title(loc) for axes in figure.axes if axes.get_visible()]  # pyright: ignore[reportArgumentType]


def test_bode_draws_the_frequency_response() -> None:
    figure = bode([linearise(x=25.0, v=1.8)])
    assert titles(figure)[:3] == ["tau_1 → F1", "tau_2 → F2", "tau_1 → v"]
    (gain,) = figure.axes[0].lines
    (phase,) = figure.axes[3].lines
    frequency, values = np.asarray(gain.get_xdata()), np.asarray(gain.get_ydata())
    assert values[0] == pytest.approx(45.0, rel=1e-3)
    assert frequency[values.argmax()] == pytest.approx(106, rel=0.05)
    assert np.asarray(phase.get_ydata())[0] == pytest.approx(0.0, abs=1.0)


def test_bode_of_a_sweep_thins_it_and_ends_at_half_the_sample_rate(sweep: list[LinearSystem]) -> None:
    figure = bode([system.discretised(0.01) for system in sweep], "x")
    lines = figure.axes[0].lines
    assert len(lines) == 7
    assert max(np.asarray(lines[0].get_xdata())) == pytest.approx(50.0)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert (labels[0], labels[-1]) == ("x = 0", "x = 50")


def test_frequencies_are_drawn_against_position(sweep: list[LinearSystem]) -> None:
    figure = modal_frequencies(sweep, "x", Plant(), 1e-3)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:3] == ["rigid drift: speed", "rope 1 – drum 1", "rope 2 – drum 2"]
    rope_1 = figure.axes[0].lines[1]
    expected = 0.8 * np.sqrt(80e9 * 4.52e-4 / (50.5 - X) / 1.8) / (2 * np.pi)
    np.testing.assert_allclose(np.asarray(rope_1.get_xdata()), X)
    np.testing.assert_allclose(np.asarray(rope_1.get_ydata()), expected, rtol=1e-3)
    assert [np.asarray(line.get_ydata())[0] for line in figure.axes[0].lines[3:]] == [500.0, 100.0]


def test_the_pole_map_holds_every_mode(sweep: list[LinearSystem]) -> None:
    figure = pole_map(sweep, "x", Plant())
    fast, slow = figure.axes[:2]
    assert [len(axes.collections) for axes in (fast, slow)] == [2, 2]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["rope 1 – drum 1", "rope 2 – drum 2", "rigid drift: position", "rigid drift: speed"]


def test_shapes_show_who_moves() -> None:
    figure = mode_shapes(linearise(x=10.0), Plant())
    assert titles(figure) == ["rigid drift: position", "rigid drift: speed", "rope 1 – drum 1", "rope 2 – drum 2"]
    marks = {}
    for axes in figure.axes:
        (drum_2, vehicle), (drum_1, _) = (
            np.asarray(line.get_ydata()) for line in axes.lines if line.get_marker() == "o"
        )
        marks[axes.get_title("left")] = [drum_2, vehicle, drum_1]
    np.testing.assert_allclose(marks["rigid drift: position"], [1, 1, 1], atol=1e-3)
    np.testing.assert_allclose(marks["rope 1 – drum 1"], [0, 0, 1], atol=1e-2)
    np.testing.assert_allclose(marks["rope 2 – drum 2"], [1, 0, 0], atol=1e-2)


def test_shapes_show_nodes_rotors_and_sag() -> None:
    site = load_ensemble("site").experiment.plant
    figure = mode_shapes(linearise(10.0, 1.0, 6000.0, site), site)
    (gear,) = [axes for axes in figure.axes if axes.get_title("left") == "gearbox 1"]
    (sag,) = [axes for axes in figure.axes if axes.get_title("left") == "sag of rope 1"]
    rotor = [float(np.asarray(line.get_ydata())[0]) for line in gear.lines if line.get_marker() == "s"][1]
    deepest = [float(np.asarray(line.get_ydata())[0]) for line in sag.lines if line.get_marker() == "v"][1]
    assert (rotor, deepest) == (1, 1)


def test_shapes_need_the_plants_states() -> None:
    one = np.eye(1)
    system = LinearSystem(one, one, one, one, None, ("a",), ("u",), ("y",), dict.fromkeys("auy", "1"))
    with pytest.raises(ConfigurationError, match="mode shapes need the states of the plant"):
        mode_shapes(system, Plant())


def test_margins_of_unstable_loops_are_not_drawn() -> None:
    shaken = override(case(2), {"controller.nftsm.smoothing": 1e-7})
    loop = linear_open_loop(shaken, 25.0, 0.5)
    figure = loop_bode([loop], [margins(loop)])
    assert titles(figure) == ["unstable: no margins", ""]
    points = amplitude_sweep(shaken, 25.0, 0.5, amplitudes=[1e-6, 1e-3])
    assert [point.margins.stable for point in points] == [False, True]
    for line in (line for axes in amplitude_margins(points).axes[:2] for line in axes.lines):
        assert np.isfinite(np.asarray(line.get_ydata())).tolist() == [False, True]
