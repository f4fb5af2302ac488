"""The least error any controller could have: against a case with a formula, and below what a controller reaches."""

from functools import cache

import numpy as np
import pytest

from dualwinch.controllers.registry import COORDINATIONS, POSITION_LAWS
from dualwinch.simulation.batch.authority import LeastErrors, infeasible_words, least_mse
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

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


@pytest.mark.parametrize(
    ("key", "kind"),
    [
        *(("controller.kind", law) for law in POSITION_LAWS),
        *(("controller.coordination.kind", coordination) for coordination in COORDINATIONS),
    ],
)
def test_no_controller_gets_below_its_line(key: str, kind: str) -> None:
    """The line of what it sees: with a preview of the reference, that of foresight."""
    experiment = override(case(4), {"controller.coordination.tension_max": 4500.0, key: kind})
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


def test_the_bound_is_found_for_a_light_machine_with_much_drag() -> None:
    """From the reference, which is not feasible, the solver ends at a point that is not feasible either."""
    light = {
        "plant.track.length": 90.0,
        "plant.vehicle.mass": 2200.0,
        "plant.vehicle.drag_coefficient": 1.0,
        "plant.vehicle.drag_area": 2.0,
        "plant.vehicle.diameter": 1.2,
        "disturbance.vortex_amplitude": 0.3,
        "controller.coordination.tension_min": 300.0,
        "controller.coordination.tension_max": 4300.0,
    }
    experiment = override(case(4), light)
    assert 0 < least_mse(experiment, anticipating=True) < least_mse(experiment) < 1


def test_runs_whose_bound_is_unknown_are_infeasible_and_left_out_of_the_mean() -> None:
    found = LeastErrors(np.array([0.0, 2.0, np.nan, 4.0]), np.array([0.0, 1.0, np.nan, np.nan]))
    assert (found.infeasible, found.unknown, found.means) == (3, 2, (1.0, 0.5))
    assert found.unknown_words.startswith("In 2 infeasible scenarios the bound could not be found")
    assert not LeastErrors(np.zeros(3), np.zeros(3)).unknown_words
    none = LeastErrors(np.full(1, np.nan), np.full(1, np.nan))
    assert np.isnan(none.means).all()


def test_one_infeasible_scenario_is_one() -> None:
    assert infeasible_words(1).startswith("1 of the scenarios is infeasible: it needs more force than")
    assert infeasible_words(2).startswith("2 of the scenarios are infeasible: they need more force than")
