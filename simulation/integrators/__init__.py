"""Integrators of the plant over one sample: methods, and the table `INTEGRATORS`."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar, where
from dualwinch.simulation.integrators.exponential import exponential, taut_step
from dualwinch.simulation.integrators.problem import Motion, Problem
from dualwinch.simulation.integrators.stability import Rate, leapfrog_rate, pole_rate

__all__ = ["INTEGRATORS", "Integrator", "Motion", "Problem"]


def _along(
    start: Motion, slope: Motion, step: Scalar, *, only: Collection[str] | None = None, but: Collection[str] = ()
) -> Motion:
    """An explicit Euler step along a slope, of all states, `only` some, or all `but` some."""
    slopes, before = leaves(slope), leaves(start)
    moving = (before.keys() if only is None else set(only)) - set(but)
    return with_leaves(start, {key: before[key] + step * slopes[key] for key in before if key in moving})


def _marked(motion: Motion, *marks: Mark) -> set[str]:
    """Keys of the states with any of these marks."""
    return {key for key, leaf in describe_parts(motion).items() if not leaf.marks.isdisjoint(marks)}


def rk4(problem: Problem, motion: Motion, t: Scalar, h: Scalar) -> Motion:
    """Motion after a step of length h in s from the time t in s, by the classical fourth-order Runge–Kutta method.

    Explicit: stable while the fastest rope–drum frequency times the sub-step is below 2.8. Its order drops to one
    where a rope goes slack or tight within a sub-step, and where friction has a state, which is updated first.
    """
    friction = _marked(motion, Mark.SETTLES)
    k1 = problem.derivative(t, motion, h)
    k2 = problem.derivative(t + h / 2, _along(motion, k1, h / 2, but=friction), h)
    k3 = problem.derivative(t + h / 2, _along(motion, k2, h / 2, but=friction), h)
    k4 = problem.derivative(t + h, _along(motion, k3, h, but=friction), h)
    sums = zip(*(leaves(k).values() for k in (k1, k2, k3, k4)), strict=True)
    total = dict(zip(leaves(k1), (a + 2 * (b + c) + d for a, b, c, d in sums), strict=True))
    return _along(motion, with_leaves(k1, total), h / 6)


def verlet(problem: Problem, motion: Motion, t: Scalar, h: Scalar) -> Motion:
    """Motion after a step of length h in s from the time t in s, by position Verlet (leapfrog: drift, kick, drift).

    One evaluation of the forces per step, at mid-step; explicit, and stable while (omega h)² + 2 d h is below 4 for
    every mode of frequency omega and of damping d over its mass (`stability.leapfrog_rate`). Frequencies have a
    relative error of (omega h)²/24, and undamped modes neither lose nor gain energy (Hairer, Lubich and Wanner,
    Geometric Numerical Integration, 2006, Section I.1.4). Damping forces are those of the speed at the beginning of the
    step: without them the method is of second order, else of first, with a relative error of the damping of half its
    rate times the step. States of friction are those of mid-steps.
    """
    kicked_on = _marked(motion, Mark.RATE, Mark.SETTLES)
    middle = _along(motion, problem.derivative(t, motion), h / 2, but=kicked_on)
    kicked = _along(middle, problem.derivative(t + h / 2, middle, h), h, only=kicked_on)
    return _along(kicked, problem.derivative(t + h, kicked), h / 2, but=kicked_on)


@dataclass(frozen=True)
class Integrator:
    """An integrator over one sample.

    Attributes:
        substep: ``(problem, motion, t, h) -> motion`` after a step of length h in s from the time t in s.
        order: halving the sub-step divides the error by 2**order on smooth stretches.
        reach: largest product of the plant's rate and sub-step in rad for which it is suitable.
        rate: that rate of each of the plant's sides; None: `stability.swing_rate`.
        any_plant: whether it supports all plants; else only massless Kelvin–Voigt ropes and rigid gears.
        one_step: ``(problem, motion) -> (motion, valid)``, a cheaper update over the whole sample in one step, to be
            used where valid > 0.
    """

    substep: Callable[[Problem, Motion, Scalar, Scalar], Motion]
    order: int
    reach: float
    rate: Rate | None = None
    any_plant: bool = False
    one_step: Callable[[Problem, Motion], tuple[Motion, Scalar]] | None = None

    def advance(self, problem: Problem, motion: Motion, substeps: int) -> Motion:
        """Motion at the end of the sample: in one step where that is valid, else in equal sub-steps."""
        h, substepped = problem.duration / substeps, motion
        for part in range(substeps):
            substepped = self.substep(problem, substepped, problem.t + part * h, h)
        if self.one_step is None:
            return substepped
        single_step, valid = self.one_step(problem, motion)
        values, whole_sample = leaves(substepped), leaves(single_step)
        return with_leaves(single_step, {key: where(valid > 0, whole_sample[key], values[key]) for key in whole_sample})


TURN = 2 * math.pi
"""A full oscillation in rad."""

INTEGRATORS = {
    "adaptive": Integrator(exponential, order=2, reach=TURN, one_step=taut_step),
    "exponential": Integrator(exponential, order=2, reach=TURN),
    "rk4": Integrator(rk4, order=4, reach=2.78, rate=pole_rate, any_plant=True),
    "verlet": Integrator(verlet, order=1, reach=1.7, rate=leapfrog_rate, any_plant=True),
}
"""Every integrator by its name."""
