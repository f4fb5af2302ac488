"""Stretches under way: where a log moves, and that rest is left out only where drums stick."""

import numpy as np

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.predictor import READINGS
from dualwinch.toolboxes.identification.resample import moving_intervals

STICKY = override(Experiment(), {"plant.winch_1.coulomb_friction": 96.0})
T = np.arange(30_000) * 1e-3


def readings(speed: np.ndarray, name: str) -> np.ndarray:
    found = np.full((len(T), len(READINGS)), np.nan)
    found[:, READINGS.index(name)] = np.cumsum(speed) * 1e-3
    return found


def test_rest_is_left_out_where_drums_stick() -> None:
    speed = np.where((T > 3) & (T < 12), 1.0, 0.0) - np.where((T > 20) & (T < 26), 0.5, 0.0)
    for name in ("x", "theta_2"):
        first, second = moving_intervals(readings(speed, name), STICKY)
        np.testing.assert_allclose([first.start, first.stop], [3000, 12000], atol=260)
        np.testing.assert_allclose([second.start, second.stop], [20000, 26000], atol=260)
        assert moving_intervals(readings(speed, name), Experiment()) == [slice(0, len(T))]


def test_where_hardly_anything_moves_nothing_is_left_out() -> None:
    short = np.where((T > 3) & (T < 4), 1.0, 0.0)
    assert moving_intervals(readings(short, "x"), STICKY) == [slice(0, len(T))]
    assert moving_intervals(np.full((len(T), len(READINGS)), np.nan), STICKY) == [slice(0, len(T))]


def test_gaps_are_bridged() -> None:
    given = readings(np.ones(len(T)), "x")
    given[5000:9000] = np.nan
    (whole,) = moving_intervals(given, STICKY)
    assert whole.stop - whole.start > 29_000
