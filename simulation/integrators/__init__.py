"""Integrators of the plant over one sample, one a file; a new one is a new file and one line in `INTEGRATORS`."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from model.rope import Rope, Track, stiffness
from model.scalar import Scalar
from model.winch import Winch
from simulation.integrators.adaptive import adaptive, single_step
from simulation.integrators.exponential import exponential
from simulation.integrators.problem import Motion, Problem
from simulation.integrators.rk4 import rk4

__all__ = ["INTEGRATORS", "Integrator", "Motion", "Problem", "swing_rate"]


@dataclass(frozen=True)
class Integrator:
    """An integrator over one sample.

    Attributes:
        advance: ``(problem, motion, substeps) -> motion`` at the sample's end.
        order: halving the sub-step divides the error by 2**order on smooth stretches.
        reach: largest `swing_rate` times sub-step in rad it is made for.
        shortcut: ``(problem, motion) -> (motion, valid)``, cheaper, with the same result wherever valid > 0.
    """

    advance: Callable[[Problem, Motion, int], Motion]
    order: int
    reach: float
    shortcut: Callable[[Problem, Motion], tuple[Motion, Scalar]] | None = None


INTEGRATORS = {
    "adaptive": Integrator(adaptive, order=2, reach=2 * math.pi, shortcut=single_step),
    "exponential": Integrator(exponential, order=2, reach=2 * math.pi),
    "rk4": Integrator(rk4, order=4, reach=2.78),
}
"""Every integrator by its name."""


def swing_rate(rope: Rope, winch: Winch, track: Track) -> float:
    """How fast in rad/s a rope and its drum swing, or settle, where the rope is shortest."""
    mobility = winch.drum_radius**2 / winch.inertia
    return max(math.sqrt(mobility * stiffness(track.rope_offset, rope)), mobility * rope.damping / 2)
