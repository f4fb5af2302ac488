"""Integrators of the plant over one sample, one a file; a new one is a new file and one line in `INTEGRATORS`."""

from collections.abc import Callable
from dataclasses import dataclass

from model.scalar import Scalar
from simulation.integrators.exponential import exponential, exponential_taut
from simulation.integrators.problem import Motion, Problem
from simulation.integrators.rk4 import rk4

__all__ = ["INTEGRATORS", "Integrator", "Motion", "Problem"]


@dataclass(frozen=True)
class Integrator:
    """An integrator over one sample.

    Attributes:
        advance: ``(problem, motion, substeps) -> motion`` at the sample's end.
        order: halving the sub-step divides the error by 2**order on smooth stretches.
        shortcut: ``(problem, motion, substeps) -> (motion, valid)``, cheaper, with the same result where valid > 0.
    """

    advance: Callable[[Problem, Motion, int], Motion]
    order: int
    shortcut: Callable[[Problem, Motion, int], tuple[Motion, Scalar]] | None = None


INTEGRATORS = {
    "exponential": Integrator(exponential, order=2, shortcut=exponential_taut),
    "rk4": Integrator(rk4, order=4),
}
"""Every integrator by its name."""
