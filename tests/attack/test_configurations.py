"""Random laws, estimators, coordinations, integrators, sample times and gains: every way to run them agrees.

Where a loop is chaotic nothing can agree: a perturbation in the last place of one number tells, in one engine alone.
"""

import math
import random
import tomllib
from typing import Any

import numpy as np
import pytest

from dualwinch.config.experiment_file import to_toml
from dualwinch.config.toml_text import flattened
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import INTEGRATORS
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

FIRST = 6
"""Seed of the first configuration; each is compiled twice."""

CALM = 1e-10
"""Largest change of a column, as a share of its size, by a perturbation of 1e-16 where a loop is not chaotic."""

ROUNDING, ELEMENTARY = 1e-7, 1e-5
"""What rounding in another order and elementary functions to 1e-9 may grow to where a loop is not chaotic."""


def configuration(seed: int) -> tuple[Experiment, dict[str, Any]]:
    """A configuration drawn at random, and what was set."""
    draw = random.Random(seed)  # noqa: S311
    chosen: dict[str, Any] = {
        "controller.kind": draw.choice([*POSITION_LAWS]),
        "controller.estimator": draw.choice([*ESTIMATORS]),
        "controller.coordination.kind": draw.choice([*COORDINATIONS]),
        "simulation.integrator": draw.choice([*INTEGRATORS]),
        "simulation.sample_time": draw.choice([0.0005, 0.001, 0.002, 0.005]),
        "simulation.delay_samples": draw.choice([0, 0, 1, 3]),
        "simulation.duration": 0.3,
        "simulation.seed": seed,
        "sensors.speed_noise": draw.choice([0.0, 1e-3]),
        "sensors.tension_noise": draw.choice([0.0, 10.0]),
        "plant.rope_slack": True,
    }
    plain = override(case(draw.randint(1, 4)), chosen)
    gains = {
        key: value
        for key, value in flattened(tomllib.loads(to_toml(plain)))
        if key.startswith("controller.") and isinstance(value, float) and value > 0 and key.count(".") == 2
    }
    for key in draw.sample(sorted(gains), 2):
        scaled = {key: gains[key] * draw.choice([0.3, 3.0])}
        try:
            plain = override(plain, scaled)
        except ConfigurationError:  # beyond its range
            continue
        chosen |= scaled
    return plain, chosen


def nudge(experiment: Experiment) -> Experiment:
    """The experiment with some numbers of its plant changed in their last place."""
    plant = experiment.plant
    numbers = {
        "vehicle.mass": plant.vehicle.mass,
        "vehicle.drag_coefficient": plant.vehicle.drag_coefficient,
        "winch_1.inertia": plant.winch_1.inertia,
        "winch_2.drum_radius": plant.winch_2.drum_radius,
    }
    return override(experiment, {f"plant.{key}": math.nextafter(number, 1e9) for key, number in numbers.items()})


def apart(ours: Result, theirs: Result) -> float:
    """The largest difference of two runs, as a share of the size of the column it is in."""
    assert len(ours["t"]) == len(theirs["t"])
    shares = [
        np.abs(ours[name] - theirs[name]).max() / max(np.abs(ours[name]).max(), 1e-3)
        for name in ("x", "v", "theta_1", "theta_2", "F1", "F2", "tau_1", "tau_2")
    ]
    return float(np.max(shares))


def check_limits(run: Result) -> None:
    limits = run.experiment.controller.limits
    for name in ("F1", "F2"):
        assert run[name].min() >= 0, "ropes do not push"
        assert run[f"{name}_cmd"].min() >= limits.tension_min * (1 - 1e-9)
        assert run[f"{name}_cmd"].max() <= limits.tension_max * (1 + 1e-9)


@pytest.mark.parametrize("configurations", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_random_configurations(configurations: int, attack: int) -> None:
    calm = 0
    for seed in range(FIRST, FIRST + configurations * attack):
        experiment, chosen = configuration(seed)
        try:
            interpreted = simulate(experiment, engine="interpreter")
        except ConfigurationError:  # a sample time that the integrator does not reach: refused by all
            with pytest.raises(ConfigurationError):
                simulate(experiment)
            continue
        nudged = simulate(nudge(experiment), engine="interpreter")
        compiled = simulate(experiment)
        batch = rollout(["plant.vehicle.mass"], [[experiment.plant.vehicle.mass]], [experiment], stride=1)
        for run in (interpreted, compiled):
            check_limits(run)
        if interpreted.outcome != nudged.outcome or not apart(interpreted, nudged) < CALM:
            continue
        calm += 1
        assert compiled.outcome == interpreted.outcome == batch.outcomes[0, 0], chosen
        assert apart(compiled, interpreted) < ROUNDING, chosen
        if interpreted.outcome == "completed":
            together = batch.columns["x"][0, 0] - compiled["x"]
            assert np.abs(together).max() < ELEMENTARY * max(np.abs(compiled["x"]).max(), 1e-3), chosen
            assert batch.columns["F1"][0, 0].min() >= 0
    assert calm
