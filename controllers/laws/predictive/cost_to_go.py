"""What lies beyond the horizon: the least cost of a triple integrator from there on, without limits.

States are the errors of position, speed and acceleration, the input is the jerk. What is least is the integral of
``position x² + speed v² + jerk²``. The best feedback ``jerk = -(k1 x + k2 v + k3 a)`` has a characteristic polynomial
``s³ + k3 s² + k2 s + k1`` whose product with its mirror image is ``-s⁶ - speed s² + position``. So ``k1² = position``,
``k2 = k3² / 2`` and ``k3⁴ / 4 - 2 k1 k3 = speed``; the Riccati equation then gives the cost.
"""

from dualwinch.model.matrix import Matrix
from dualwinch.model.scalar import Scalar, power, sqrt

NEWTON_STEPS = 12
"""From above, on a convex function: they converge for all weights."""


def optimal_feedback(position: Scalar, speed: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """k1, k2 and k3 for a weight of the position in 1/s⁶ and of the speed in 1/s⁴, beside 1 of the jerk."""
    k1 = sqrt(position)
    k3 = 2 * power(k1, 1 / 3) + sqrt(2 * sqrt(speed))
    for _ in range(NEWTON_STEPS):
        k3 = k3 - (k3**4 / 4 - 2 * k1 * k3 - speed) / (k3**3 - 2 * k1)
    return k1, k3**2 / 2, k3


def cost_to_go(position: Scalar, speed: Scalar) -> Matrix:
    """(3, 3) quadratic form of the errors of position, speed and acceleration; weights as `optimal_feedback`."""
    k1, k2, k3 = optimal_feedback(position, speed)
    return (k1 * k2, k1 * k3, k1), (k1 * k3, k2 * k3 - k1, k2), (k1, k2, k3)
