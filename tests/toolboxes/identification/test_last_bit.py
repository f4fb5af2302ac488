"""The last bit of a log decides nothing: the same model and numbers, whatever a compiler or a BLAS kernel does."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.identify import identify
from tests.last_bit import SEEDS, perturbed
from tests.toolboxes.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.rope_*.modulus")

RIGHT = machine(sensors__speed_noise=5e-4, simulation__duration=6.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "off",
    [{}, {"plant.winch_1.inertia": 1.95, "plant.winch_2.inertia": 1.65}],
    ids=["as described", "inertia is off"],
)
def test_model_and_numbers_do_not_hang_on_it(off: dict[str, float]) -> None:
    log, nominal = logged(override(RIGHT, off)), override(RIGHT, {"plant.vehicle.mass": 1.05e4})
    found = identify(log, KEYS, nominal, workers=1)
    for seed in SEEDS:
        moved = identify(replace(log, columns=perturbed(dict(log.columns), seed)), KEYS, nominal, workers=1)
        assert [each.alternatives for each in moved.models] == [each.alternatives for each in found.models]
        assert np.argmin([each.criterion for each in moved.models]) == np.argmin(
            [each.criterion for each in found.models]
        )
        assert np.abs((moved.values - found.values) / found.deviations).max() < 0.05
