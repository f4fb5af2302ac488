"""Designs for machines of very different sizes: stable, damped and quiet, and what limits them is said."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.design import (
    BISECTIONS,
    NOISE,
    STEP,
    Design,
    designed,
    formula_design,
    tension_noise,
)
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment


def machine(base: Experiment, mass: float, rope: float, winch: dict[str, float], **values: Any) -> Experiment:
    """A machine on two equal steel wire ropes of a diameter in m."""
    area, own = 0.455 * rope**2, 4090 * rope**2
    ropes = {"diameter": rope, "area": area, "modulus": 1e11, "mass_per_length": own, "submerged_weight": 8.6 * own}
    sides = {f"plant.rope_{side}.{key}": value for side in (1, 2) for key, value in ropes.items()}
    sides |= {f"plant.winch_{side}.{key}": value for side in (1, 2) for key, value in winch.items()}
    settings = {name.replace("__", "."): value for name, value in values.items()}
    length = settings["plant.track.length"]
    settings |= {"reference.kind": "way-points", "reference.points": [0.9 * length, 0.1 * length]}
    settings = {"plant.vehicle.normal_force": 0.5 * mass} | settings
    return dw.override(base, {"plant.vehicle.mass": mass, **sides, **settings})


def preload(tension_max: float) -> dict[str, float]:
    limits = {"tension_max": tension_max, "tension_min": tension_max / 15, "preload": 0.5 * tension_max}
    return {f"controller__coordination__{name}": value for name, value in limits.items()}


SITE = dw.load_ensemble("site").experiment
MACHINES = {
    "a ferry": machine(
        Experiment(), 1.5e5, 0.04, {"inertia": 500.0, "drum_radius": 0.6, "gear_ratio": 60.0, "rotor_inertia": 0.5},
        plant__track__length=180.0, plant__vehicle__friction_coefficient=0.02, simulation__sample_time=0.01,
        simulation__delay_samples=1, simulation__substeps=60, sensors__position_noise=0.02, sensors__speed_noise=0.02,
        plant__rope_1__damping=2e4, plant__rope_2__damping=2e4, **preload(1.2e5),
    ),
    "a laboratory": machine(
        Experiment(), 30.0, 0.003, {"inertia": 4e-4, "drum_radius": 0.04, "gear_ratio": 5.0, "rotor_inertia": 1e-4},
        plant__track__length=8.0, plant__vehicle__normal_force=300.0, plant__vehicle__friction_coefficient=0.02,
        plant__vehicle__drag_area=0.1, simulation__sample_time=5e-4, simulation__delay_samples=1,
        simulation__substeps=8, plant__rope_1__damping=60.0, plant__rope_2__damping=60.0, **preload(240.0),
    ),
    "small": machine(
        Experiment(), 1e3, 0.003, {"inertia": 0.3, "drum_radius": 0.1, "gear_ratio": 20.0, "rotor_inertia": 2e-4},
        plant__track__length=10.0, simulation__delay_samples=1, simulation__substeps=16,
        plant__rope_1__damping=20.0, plant__rope_2__damping=20.0, **preload(800.0),
    ),
    "light and long": machine(
        SITE, 2e3, 0.008, {"inertia": 5.0, "drum_radius": 0.3, "gear_ratio": 30.0, "rotor_inertia": 2e-3,
                           "gear_stiffness": 1e5, "gear_damping": 20.0},
        plant__track__length=200.0, simulation__sample_time=0.002,
        simulation__substeps=8, **preload(3e3),
    ),
    "heavy": machine(
        SITE, 1e5, 0.05, {"inertia": 3e3, "drum_radius": 1.0, "gear_ratio": 60.0, "rotor_inertia": 0.5,
                          "gear_stiffness": 2e7, "gear_damping": 1e4},
        plant__track__length=100.0, simulation__sample_time=0.004,
        simulation__substeps=12, **preload(1.2e5),
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_machines_of_every_size_get_a_stable_start(name: str) -> None:
    design = designed(MACHINES[name])
    assert not design.violations, str(design)
    assert 0 < design.bandwidth <= design.limits[0].bandwidth
    loop = dw.linear_closed_loop(design.experiment)
    assert abs(loop.poles()).max() < 1
    assert len(str(design).splitlines()) == 5


def test_the_tensions_noise_is_proportional_to_the_sensors() -> None:
    noises = {"sensors.position_noise": 1e-3, "sensors.speed_noise": 1e-2}
    experiments = [dw.override(dw.case(4), {key: share * noise for key, noise in noises.items()}) for share in (1, 3)]
    assert tension_noise(dw.case(4)) == 0
    assert tension_noise(experiments[1]) == pytest.approx(3 * tension_noise(experiments[0]), rel=1e-6)


@pytest.fixture(scope="module")
def noisy() -> Design:
    return designed(dw.override(Experiment(), {"sensors.position_noise": 5e-3, "sensors.speed_noise": 2e-2}))


@pytest.mark.slow
def test_noise_lowers_the_bandwidth_until_no_rope_becomes_slack(noisy: Design) -> None:
    quiet = noisy.controller.limits.tension_min / 4
    assert not noisy.violations
    assert noisy.noise < quiet
    assert noisy.shares.bandwidth < 0.5
    step = STEP ** (1 / 2**BISECTIONS)
    faster = replace(noisy.shares, bandwidth=noisy.shares.bandwidth / step)
    assert tension_noise(formula_design(noisy.experiment, faster)) > quiet, "the last step, bisected"


@pytest.mark.slow
def test_the_tensions_noise_is_that_of_a_long_run(noisy: Design) -> None:
    """What noise adds near rest at mid-track, over half a minute, without the observer's rules for large errors."""
    still = {"reference.kind": "way-points", "reference.points": [25.0], "simulation.duration": 60.0}
    machine = dw.override(noisy.experiment, still | {"controller.observer.kf": 0.0})
    quiet = dw.override(machine, {"sensors.position_noise": 0.0, "sensors.speed_noise": 0.0})
    tensions = [run["F1"][run["t"] > 30] for run in map(dw.simulate, (machine, quiet))]
    assert np.std(tensions[0] - tensions[1]) == pytest.approx(tension_noise(machine), rel=0.2)


@pytest.mark.slow
def test_gains_that_are_kept_stay_and_others_follow(noisy: Design) -> None:
    key = "controller.kalman.bandwidth"
    kept = designed(dw.override(noisy.experiment, {key: 7.0}), kept=[key])
    assert leaves(kept.experiment)[key] == 7.0
    assert NOISE not in kept.violations
    assert tension_noise(kept.experiment) == kept.noise
