import pytest

import dualwinch as dw
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import operating_point
from dualwinch.model.plant import Plant

STRONG = {
    "plant.track.length": 120,
    "controller.coordination.tension_min": 500,
    "controller.coordination.tension_max": 24000,
    "controller.coordination.preload": 15000,
}


def test_limits_preload_and_plant_come_from_the_experiment() -> None:
    strong = dw.override(dw.case(4), STRONG)
    point = dw.operating_point(experiment=strong, v=2.5)
    assert (point.x, point.preload) == (60, 15000)
    assert not point.violations
    same = operating_point(60, 2.5, 15000, strong.plant, tension_min=500, tension_max=24000)
    assert point == same
    assert dw.operating_point(10, 1.0, 1600, experiment=strong, tension_min=0).preload == 1600
    with pytest.raises(ConfigurationError, match="preload"):
        dw.operating_point(experiment=strong, preload=50_000)


def test_without_an_experiment_they_are_the_papers() -> None:
    assert dw.operating_point(10, 1.8) == operating_point(10, 1.8)
    assert dw.operating_point() == operating_point()
    longer = dw.override(dw.case(4), {"plant.track.length": 120}).plant
    assert dw.operating_point(plant=longer) == operating_point(60, plant=longer)
    assert dw.operating_point(10, 1.8, 2500, Plant()) == operating_point(10, 1.8, 2500, Plant())
