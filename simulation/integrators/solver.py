"""Which integrator solves an experiment, and with how many sub-steps: what it asks for, where its ropes allow that."""

import math
from typing import NamedTuple

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.ropes import is_kelvin_voigt
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import INTEGRATORS
from dualwinch.simulation.integrators.swing_rate import fastest_rate

GENERAL = "rk4"
"""The integrator of ropes that the others do not know."""

FINE = 0.5
"""Rate of the fastest swing times sub-step in rad, at most, where nobody says how many sub-steps."""

OVERSHOOT = 1.5
"""Tension beyond tension_max, as a factor, that sub-steps still keep up with."""


class Solver(NamedTuple):
    """An integrator by its name, and its sub-steps a sample."""

    integrator: str
    substeps: int

    def __str__(self) -> str:
        return f"{self.integrator} with {self.substeps} sub-steps"


def is_automatic(experiment: Experiment) -> bool:
    """Whether the ropes decide about integrator and sub-steps: one of them is no Kelvin–Voigt rope."""
    return not all(map(is_kelvin_voigt, (experiment.plant.rope_1, experiment.plant.rope_2)))


def solver_of(experiment: Experiment) -> Solver:
    """Integrator and sub-steps of an experiment.

    With Kelvin–Voigt ropes they are those it asks for. Ropes of other laws take an integrator that knows nothing of
    them, with at least as many sub-steps as it asks for, and a power of two of them that keeps up with the stiffest
    spring on the track, at tensions up to `OVERSHOOT` times tension_max.

    Raises:
        ConfigurationError: a rope's law has no finite spring rate at these tensions.
    """
    simulation = experiment.simulation
    if not is_automatic(experiment):
        return Solver(simulation.integrator, simulation.substeps)
    integrator = simulation.integrator if INTEGRATORS[simulation.integrator].any_rope else GENERAL
    needed = math.ceil(max(swing_rates(experiment)) * simulation.sample_time / FINE)
    return Solver(integrator, max(simulation.substeps, 1 << (needed - 1).bit_length()))


def swing_rates(experiment: Experiment) -> tuple[float, float]:
    """Fastest swings in rad/s of both ropes with their drums, at tensions that occur.

    Raises:
        ConfigurationError: a rope's law has no finite spring rate at these tensions.
    """
    plant, limits = experiment.plant, experiment.controller.limits
    tensions = (limits.tension_min, limits.preload / 2, limits.tension_max, OVERSHOOT * limits.tension_max)
    rates = []
    for number, rope, winch in ((1, plant.rope_1, plant.winch_1), (2, plant.rope_2, plant.winch_2)):
        rate = fastest_rate(rope, winch, plant.track, tensions)
        if not math.isfinite(rate):
            raise ConfigurationError(
                f"plant.rope_{number}: the tension of '{rope.kind}' must grow with the stretch, "
                f"at {tensions[0]:g} to {tensions[-1]:g} N too"
            )
        rates.append(rate)
    return rates[0], rates[1]
