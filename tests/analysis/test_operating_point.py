from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from tests.plant_points import operating_point

STRONG = {
    "plant.track.length": 120,
    "controller.coordination.tension_min": 500,
    "controller.coordination.tension_max": 24000,
    "controller.coordination.preload": 15000,
}


def test_limits_preload_and_plant_come_from_the_experiment() -> None:
    strong = dw.override(dw.case(4), STRONG)
    point = dw.operating_point(strong, v=2.5)
    assert (point.x, point.preload) == (60, 15000)
    assert not point.violations
    same = operating_point(60, 2.5, 15000, strong.plant, tension_min=500, tension_max=24000)
    assert point == same
    assert dw.operating_point(strong, 10, 1.0, preload=1600, tension_min=0).preload == 1600
    with pytest.raises(ConfigurationError, match="preload"):
        dw.operating_point(strong, preload=50_000)


def test_amid_the_track_is_where_loops_are_linearised() -> None:
    strong = dw.override(dw.case(4), STRONG)
    assert dw.linear_open_loop(strong).operating_point["x"] == 60
    assert dw.linear_closed_loop(strong).operating_point["x"] == 60
    (point,) = dw.amplitude_sweep(strong, amplitudes=[1e-3])
    assert point.system.operating_point["x"] == 60


@pytest.mark.parametrize("of", [dw.operating_point, dw.linearise, dw.linear_closed_loop, dw.linear_open_loop])
@pytest.mark.parametrize(
    ("x", "v", "words"),
    [
        (np.array([1, 2]), 0.0, "x: must be one number, not 2"),
        (1, [1.0, 2.0, 3.0], "v: must be one number, not 3"),
        (1, None, "v: must be a number, not NoneType"),
        ("1", 0.0, "x: must be a number, not str"),
    ],
)
def test_a_point_is_one_number_each_of_an_experiment(of: Callable[..., object], x: Any, v: Any, words: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{words}"):
        of(dw.case(2), x, v)
    with pytest.raises(ConfigurationError, match=r"experiment: must be an Experiment, which .* not Plant"):
        of(dw.case(2).plant, 10)


@pytest.mark.parametrize("of", [dw.operating_point, dw.linearise])
@pytest.mark.parametrize("name", ["x", "v", "preload"])
def test_many_points_of_the_plant_are_sent_to_where_arrays_are_taken(of: Callable[..., object], name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{name}: must be one number, not 2; operating_points of"):
        of(dw.case(2), **{name: [2000, 3000]})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"dt": "a"}, "dt: must be a number"),
        ({"dt": [1e-3, 2e-3]}, "dt: must be one number"),
        ({"current": "a"}, "current: must be a number"),
        ({"tension_max": None, "tension_min": "a"}, "tension_min: must be a number"),
        ({"plant": Plant()}, "unknown argument 'plant'; .*; the plant is that of the experiment"),
    ],
)
def test_what_else_is_wrong_is_named(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{words}"):
        dw.linearise(dw.case(2), 1, **arguments)
