"""Integrators of the plant over one sample, one a file; a new one is a new file and one line in `INTEGRATORS`."""

from collections.abc import Callable
from dataclasses import dataclass

from simulation.integrators.problem import Motion, Problem
from simulation.integrators.rk4 import rk4

__all__ = ["INTEGRATORS", "Integrator", "Motion", "Problem"]


@dataclass(frozen=True)
class Integrator:
    """An integrator and its order: halving the sub-step divides the error by 2**order on smooth stretches."""

    advance: Callable[[Problem, Motion, int], Motion]
    order: int


INTEGRATORS = {"rk4": Integrator(rk4, order=4)}
"""Every integrator by its name."""
