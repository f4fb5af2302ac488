"""The least error any controller could have: against a case with a formula, and below what a controller reaches."""

from functools import cache

import numpy as np
import pytest

from dualwinch.controllers.registry import COORDINATIONS, POSITION_LAWS
from dualwinch.simulation.analysis.authority import least_mse
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.tiers import each_choice

BARE = {
    "plant.vehicle.drag_coefficient": 0.0,
    "plant.vehicle.friction_coefficient": 0.0,
    "plant.winch_1.inertia": 1e-9,
    "plant.winch_2.inertia": 1e-9,
}


def test_within_the_actuators_authority_it_is_zero() -> None:
    assert least_mse(case(4)) == 0


@pytest.mark.parametrize("anticipating", [False, True])
def test_without_a_chance_to_catch_up_it_is_what_full_force_leaves(anticipating: bool) -> None:
    """A mass of 10 t is to gain 0.1 m/s² for 10 s with 900 N: it falls behind by 0.01 m/s² t²/2."""
    experiment = override(
        Experiment(),
        BARE | {"simulation.duration": 10.0, "controller.coordination.tension_max": 1100.0},
    )
    expected = 0.01**2 * 10**4 / 20
    assert least_mse(experiment, anticipating=anticipating) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(("law", "coordination"), each_choice(POSITION_LAWS, COORDINATIONS))
def test_no_controller_gets_below_its_line(law: str, coordination: str) -> None:
    """The line of what it sees: with a preview of the reference, that of foresight."""
    lacking = {"controller.coordination.tension_max": 4500.0, "controller.coordination.kind": coordination}
    experiment = override(case(4, law), lacking)
    line = _line(bool(experiment.controller.preview))
    run = simulate(experiment, stride=0)
    assert run.outcome == "completed"
    assert 0 < line < run.metrics.mse


@cache
def _line(anticipating: bool) -> float:
    """No law or coordination plays a part in it."""
    return least_mse(override(case(4), {"controller.coordination.tension_max": 4500.0}), anticipating=anticipating)


def test_no_controller_gets_below_and_foresight_helps() -> None:
    experiment = override(case(4), {"controller.coordination.tension_max": 4500.0})
    blind, clairvoyant = (least_mse(experiment, anticipating=ahead) for ahead in (False, True))
    assert 0 < clairvoyant < blind < simulate(experiment).metrics.mse
    assert np.isfinite(blind)
