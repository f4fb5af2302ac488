"""What a run asks of its motors: against the equations written out, and against what a run that tracks takes."""

import math

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.batch.authority import force_demands, force_law, force_parameters, outside_at
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate


def required_force(experiment: Experiment, every: int = 50) -> np.ndarray:
    return np.array(force_law()(outside_at(experiment, every), force_parameters(experiment))).ravel()


def test_it_is_the_plants_equation_on_the_reference() -> None:
    experiment = override(
        Experiment(),
        {
            "disturbance.vortex": True,
            "plant.winch_1.coulomb_friction": 96.0,
            "plant.winch_2.viscous_friction": 5.0,
            "plant.winch_2.inertia": 2.0,
        },
    )
    t = 10.0
    v, a = 0.1 * t, 0.1  # the paper's profile: 1.8 m/s after 18 s
    drag = 0.5 * 0.3 * 1000 * 6 * v**2
    vortex = 0.2 * drag * math.sin(2 * math.pi * 0.2 * v / 2.0 * t)
    vehicle = 1e4 * a + 0.1 * 4.9e3 * math.tanh(v / 0.01) + drag - vortex
    omega, alpha = v / 0.8, a / 0.8
    drums = 1.8 * alpha + 96.0 * math.tanh(omega / 0.01) + 2.0 * alpha + 5.0 * omega
    assert required_force(experiment, 1000)[10] == pytest.approx(vehicle + drums / 0.8, rel=1e-12)


@pytest.mark.parametrize("integrated", [False, True])
def test_a_run_that_tracks_takes_that_force(integrated: bool) -> None:
    sea = {"disturbance.integrated_phase": integrated, "disturbance.current_sigma": 0.05, "simulation.seed": 5}
    tight = {"controller.observer.l0": 100.0, "controller.nftsm.eta": 20.0}  # errors of 0.02 mm
    experiment = override(case(4), sea | tight)
    columns = simulate(experiment).columns
    taken = (columns["F1"] - columns["F2"])[::50]
    assert np.abs(required_force(experiment) - taken)[1:].max() < 20  # of 4 kN


def test_the_shortfall_is_what_full_force_leaves() -> None:
    """A mass of 10 t is to gain 0.1 m/s² for 10 s with 900 N: it falls behind by 0.01 m/s² (10 s)²/2."""
    bare = {
        "plant.vehicle.drag_coefficient": 0.0,
        "plant.vehicle.friction_coefficient": 0.0,
        "plant.winch_1.inertia": 1e-9,
        "plant.winch_2.inertia": 1e-9,
        "simulation.duration": 10.0,
    }
    limited = {"controller.coordination.tension_max": 1100.0}
    weak, strong = force_demands([override(Experiment(), bare | limited), override(Experiment(), bare)])
    assert weak.shortfall == pytest.approx(0.5, rel=0.02)
    assert strong.shortfall == 0


@pytest.mark.parametrize("name", ["rig", "site"])
def test_the_demand_of_many_runs_is_that_of_each(name: str) -> None:
    scenarios = load_ensemble(name).chosen(range(20), 3, vertex=True)
    strength = scenarios[0].base.controller.limits.strength
    alone = [np.abs(required_force(each.experiment)).max() / strength for each in scenarios]
    assert [demand.share for demand in force_demands(scenarios)] == pytest.approx(alone, rel=1e-12)
