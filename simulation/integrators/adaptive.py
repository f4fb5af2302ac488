"""The exponential integrator in one step, and where that is good enough.

It is where neither rope can go slack within the sample and no dry friction bends. That is most of the
time; start-up, slack and the first centimetres of a hard start get the careful steps. Equations are those of
docs/exponential-integrator.md.
"""

from dualwinch.model.scalar import Scalar, absolute, maximum, minimum, where
from dualwinch.model.winch import FRICTION_SPEED
from dualwinch.simulation.integrators.exponential import exponential_step
from dualwinch.simulation.integrators.problem import Motion, Problem

FRICTION_REACH = 3.0
"""Speed over the friction's own beyond which friction is constant: tanh(3) = 0.995."""

RAIL_STEP, WINCH_STEP = 0.02, 0.2
"""Change of speed over the friction's own that one step may bridge where friction bends, on the rail and in a winch."""


def taut_step(problem: Problem, motion: Motion) -> tuple[Motion, Scalar]:
    """Motion at the end of the sample in one step, and a number that is positive where that is good enough.

    It is where both ropes surely stay taut (Eq. 27) and no dry friction bends, on the rail or in a winch (Eq. 28).
    """
    moved, clearance = exponential_step(problem, motion, problem.t, problem.duration, slack=False)
    before, after, plant = motion.plant, moved.plant, problem.plant
    least = _straightness(before.v, after.v, plant.vehicle.friction_velocity, RAIL_STEP)
    for winch, start, end in (
        (plant.winch_1, before.omega_1, after.omega_1),
        (plant.winch_2, before.omega_2, after.omega_2),
    ):
        with_winch = minimum(least, _straightness(start, end, FRICTION_SPEED, WINCH_STEP))
        least = where(winch.coulomb_friction > 0, with_winch, least)
    return moved, minimum(least, clearance) if plant.rope_slack else least


def _straightness(start: Scalar, end: Scalar, scale: Scalar, step: float) -> Scalar:
    """Positive where tanh(speed/scale) does not bend on the way: too fast, or hardly a change of speed (Eq. 28)."""
    least = where(start * end > 0, minimum(absolute(start), absolute(end)), 0.0)
    fast = least / scale - FRICTION_REACH
    steady = step - absolute(end - start) / scale
    return maximum(fast, steady)
