"""What the position law sees."""

from typing import Any

import pytest

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.registry import ESTIMATORS
from dualwinch.controllers.signals import Measurement, Seen
from dualwinch.model.plant import Plant

SEEN = Measurement(1.2, 0.7, 1500.0, 900.0, 0.9, -0.9, 1.5, -1.5)


@pytest.mark.parametrize("name", ["none", "lowpass"])
def test_by_default_the_measurement_passes_as_it_is(name: Any) -> None:
    estimator = ESTIMATORS[name]
    _, seen = estimator.step(estimator.initial_state, SEEN, Controller(), Plant(), 1e-3)
    assert seen == Seen(**vars(SEEN))


def test_a_filter_time_is_for_the_lowpass_only() -> None:
    controller = Controller(speed_filter_time=0.1)
    seen = {
        name: estimator.step(estimator.initial_state, SEEN, controller, Plant(), 1e-3)[1]
        for name, estimator in ESTIMATORS.items()
    }
    assert seen["none"] == Seen(**vars(SEEN))
    assert seen["lowpass"].v == pytest.approx(0.7 / 101)
    assert seen["lowpass"].x == SEEN.x
