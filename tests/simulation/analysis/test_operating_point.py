from collections.abc import Callable

import pytest

import dualwinch as dw
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import operating_point

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


@pytest.mark.parametrize("of", [dw.operating_point, dw.linearise, dw.linear_closed_loop, dw.linear_broken_loop])
def test_a_plant_alone_has_neither_limits_nor_preload(of: Callable[..., object]) -> None:
    with pytest.raises(ConfigurationError, match=r"experiment: must be an Experiment, which .* not Plant"):
        of(dw.override(dw.case(4), STRONG).plant, 10)


def test_amid_the_track_is_where_loops_are_linearised() -> None:
    strong = dw.override(dw.case(4), STRONG)
    assert dw.linear_broken_loop(strong).operating_point["x"] == 60
    assert dw.linear_closed_loop(strong).operating_point["x"] == 60
    (point,) = dw.amplitude_sweep(strong, amplitudes=[1e-3])
    assert point.system.operating_point["x"] == 60
