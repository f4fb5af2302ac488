"""The exponential integrator in one step where that is good enough, and in several where it is not.

One step is enough where neither rope can go slack within the sample and the rail friction does not bend. That is most
of the time; start-up, slack and the first centimetres of a hard start get the careful steps.
"""

from model.quantity import leaves, with_leaves
from model.scalar import Scalar, absolute, maximum, minimum, where
from simulation.integrators.exponential import exponential, in_equal_steps
from simulation.integrators.problem import Motion, Problem

FRICTION_REACH = 4.0
"""Speed over the friction velocity beyond which friction is constant: tanh(4) = 0.9993."""

FRICTION_STEP = 0.02
"""Change of speed over the friction velocity that one step may bridge where friction bends."""


def adaptive(problem: Problem, motion: Motion, substeps: int) -> Motion:
    """Motion at the end of the sample: in one step where `taut_step` is good enough, else in equal sub-steps."""
    taut, valid = taut_step(problem, motion)
    if not problem.plant.rope_slack:
        return taut
    careful, taut_values = leaves(exponential(problem, motion, substeps)), leaves(taut)
    return with_leaves(taut, {key: where(valid > 0, taut_values[key], careful[key]) for key in taut_values})


def taut_step(problem: Problem, motion: Motion) -> tuple[Motion, Scalar]:
    """Motion at the end of the sample in one step, and a number that is positive where that is good enough.

    It is where both ropes surely stay taut and the rail friction does not bend: the vehicle is either too fast for its
    friction to change or hardly changes its speed.
    """
    moved, clearance = in_equal_steps(problem, motion, 1, slack=False)
    scale = problem.plant.vehicle.friction_velocity
    fast = absolute(motion.plant.v) / scale - FRICTION_REACH
    steady = FRICTION_STEP - absolute(moved.plant.v - motion.plant.v) / scale
    return moved, minimum(clearance, maximum(fast, steady))
