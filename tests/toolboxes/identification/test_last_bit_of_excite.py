"""The design of a motion on ten computers, which differ in the last bit."""

from dataclasses import replace

import numpy as np
import pytest

import dualwinch as dw
from tests.last_bit import SEEDS, perturbed

NOISY = dw.override(dw.case(4), {"sensors.tension_noise": 10.0, "sensors.position_noise": 5e-4})


@pytest.mark.slow
def test_the_motion_and_what_to_expect_of_it_are_the_same() -> None:
    design = dw.excite("plant.vehicle.mass, plant.rope_1.modulus", NOISY, duration=10.0, trials=16)
    deviations = np.sqrt(np.diag(design.covariance))
    for seed in SEEDS[:3]:
        moved = replace(perturbed(NOISY, seed), controller=NOISY.controller)
        near = dw.excite("plant.vehicle.mass, plant.rope_1.modulus", moved, duration=10.0, trials=16)
        np.testing.assert_allclose(near.experiment.reference.points, design.experiment.reference.points, rtol=1e-6)
        np.testing.assert_allclose(np.sqrt(np.diag(near.covariance)), deviations, rtol=1e-6)
