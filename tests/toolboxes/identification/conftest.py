"""Logs of simulated machines."""

from functools import cache

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.log import Log, log_of

SENSORS = {
    "sensors.position_noise": 5e-4,
    "sensors.position_resolution": 1e-3,
    "sensors.speed_noise": 2e-3,
    "sensors.tension_noise": 10.0,
    "sensors.encoder_counts": 4096,
    "sensors.position_drift": 1e-4,
    "simulation.delay_samples": 1,
    "simulation.readings": True,
}
"""Common sensors, one sample late."""

SEA = {"disturbance.current_sigma": 0.05, "disturbance.normal_force_sigma": 0.1}


def machine(**settings: object) -> Experiment:
    """Case 4 of the paper with common sensors, 20 s of it."""
    changed = {key.replace("__", "."): value for key, value in settings.items()}
    return override(case(4), SENSORS | SEA | {"simulation.duration": 20.0} | changed)


@cache
def logged(experiment: Experiment) -> Log:
    """The log of a run."""
    return log_of(simulate(experiment))
