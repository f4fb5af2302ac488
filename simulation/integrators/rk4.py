"""The classical fourth-order Runge–Kutta method.

Explicit: stable while the fastest rope–drum frequency times the sub-step stays below 2.8. Its order drops to one
where a rope goes slack or tight within a sub-step.
"""

from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.integrators.problem import Motion, Problem


def _along(start: Motion, slope: Motion, step: Scalar) -> Motion:
    slopes = leaves(slope)
    return with_leaves(start, {key: value + step * slopes[key] for key, value in leaves(start).items()})


def rk4(problem: Problem, motion: Motion, t: Scalar, h: Scalar) -> Motion:
    """Motion after a step of length h in s from the time t in s."""
    k1 = problem.derivative(t, motion)
    k2 = problem.derivative(t + h / 2, _along(motion, k1, h / 2))
    k3 = problem.derivative(t + h / 2, _along(motion, k2, h / 2))
    k4 = problem.derivative(t + h, _along(motion, k3, h))
    sums = zip(*(leaves(k).values() for k in (k1, k2, k3, k4)), strict=True)
    total = dict(zip(leaves(k1), (a + 2 * (b + c) + d for a, b, c, d in sums), strict=True))
    return _along(motion, with_leaves(k1, total), h / 6)
