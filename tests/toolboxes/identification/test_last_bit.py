"""The last bit of a log chooses no model, whatever a compiler or a BLAS kernel does."""

from dataclasses import replace

import pytest

from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.identify import identify
from tests.last_bit import SEEDS, perturbed
from tests.toolboxes.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.rope_*.modulus")

RIGHT = machine(sensors__speed_noise=5e-4, simulation__duration=6.0)


@pytest.mark.slow
def test_the_choice_of_a_model_does_not_hang_on_it() -> None:
    log, nominal = logged(RIGHT), override(RIGHT, {"plant.vehicle.mass": 1.05e4})
    kinds = [each.alternatives for each in identify(log, KEYS, nominal, workers=1).models]
    for seed in SEEDS:
        moved = replace(log, columns=perturbed(dict(log.columns), seed))
        assert [each.alternatives for each in identify(moved, KEYS, nominal, workers=1).models] == kinds
