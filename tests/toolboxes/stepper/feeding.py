"""Feeds steppers with recorded commands."""

import numpy as np

from dualwinch.simulation.results.result import Result
from dualwinch.toolboxes.stepper.stepper import Stepper

PLANT = ("t", "x", "v", "theta_1", "omega_1", "theta_2", "omega_2", "x_ref", "v_ref", "a_ref", "e", "F1", "F2")
"""Columns of the plant and of the reference."""


def torques_of(result: Result) -> np.ndarray:
    """(samples, 2) in N m."""
    return np.stack([result["tau_1"], result["tau_2"]], axis=1)


def feed(stepper: Stepper, commands: np.ndarray) -> None:
    """Give all lanes the same commands (steps, ...)."""
    for command in commands:
        stepper.step(np.broadcast_to(command, (stepper.batch, *command.shape)))
