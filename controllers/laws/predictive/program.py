"""The quadratic program of a sample of predictive control, in the changes of force over the horizon.

The model is a mass with a piecewise linear acceleration. The cost weights errors of position and speed against changes
of acceleration, in the form that `box` minimises.

The terminal cost is the least cost of an unconstrained triple integrator with the errors of position, speed and
acceleration as states and the jerk as input: the integral of ``position x² + speed v² + jerk²``. The optimal feedback
``jerk = -(k1 x + k2 v + k3 a)`` has a characteristic polynomial ``s³ + k3 s² + k2 s + k1`` whose product with its
mirror image is ``-s⁶ - speed s² + position``. So ``k1² = position``, ``k2 = k3² / 2`` and ``k3⁴ / 4 - 2 k1 k3 =
speed``; the Riccati equation then gives the cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.matrix import Matrix, dot, plus, times, transpose
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, maximum, minimum, power, sqrt

GROWTH = 1.6
"""Ratio of the lengths of successive stages: the near future is resolved finely."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Stages of the horizon, and the response of the motion to changes of acceleration.

    Attributes:
        lengths: (n,) lengths of the stages in s.
        times: (n,) times of their ends in s.
        weights: (n,) weights of the ends in s, by the trapezoidal rule.
        of_position, of_speed: (n, n) change of position in m and of speed in m/s at each end, per acceleration in m/s²
            at each; lower triangular.
        of_change: (n, n) sum over the stages of squared changes of acceleration over length, as a quadratic form.
    """

    lengths: Floats
    times: Floats
    weights: Floats
    of_position: Floats
    of_speed: Floats
    of_change: Floats


@lru_cache(maxsize=64)
def prediction(horizon: float, stages: int) -> Prediction:
    """The prediction over a horizon in s."""
    growing = GROWTH ** np.arange(stages)
    lengths = horizon * growing / growing.sum()
    position, speed = np.zeros((stages, stages)), np.zeros((stages, stages))
    before = np.eye(stages, k=-1)
    x = v = np.zeros(stages)
    for k, (h, last, now) in enumerate(zip(lengths, before, np.eye(stages), strict=True)):
        x = x + h * v + h**2 * (last / 3 + now / 6)
        v = v + h * (last + now) / 2
        position[k], speed[k] = x, v
    difference = np.eye(stages) - before
    return Prediction(
        lengths=lengths,
        times=np.cumsum(lengths),
        weights=(lengths + np.append(lengths[1:], 0.0)) / 2,
        of_position=position,
        of_speed=speed,
        of_change=difference.T @ np.diag(1 / lengths) @ difference,
    )


NEWTON_STEPS = 12
"""Newton steps; they converge for all weights, from above on a convex function."""


def optimal_feedback(position: Scalar, speed: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """k1, k2 and k3 for weights of the position in 1/s⁶ and of the speed in 1/s⁴, relative to the jerk."""
    k1 = sqrt(position)
    k3 = 2 * power(k1, 1 / 3) + sqrt(2 * sqrt(speed))
    for _ in range(NEWTON_STEPS):
        k3 = k3 - (k3**4 / 4 - 2 * k1 * k3 - speed) / (k3**3 - 2 * k1)
    return k1, k3**2 / 2, k3


def cost_to_go(position: Scalar, speed: Scalar) -> Matrix:
    """(3, 3) quadratic form of the errors of position, speed and acceleration; weights as in `optimal_feedback`."""
    k1, k2, k3 = optimal_feedback(position, speed)
    return (k1 * k2, k1 * k3, k1), (k1 * k3, k2 * k3 - k1, k2), (k1, k2, k3)


Column = tuple[Scalar, ...]


class Program(NamedTuple):
    """Minimise ``y' quadratic y / 2 + linear' y`` for ``lower <= y <= upper``.

    Attributes:
        quadratic: (n, n).
        linear, lower, upper: (n,).
    """

    quadratic: Matrix
    linear: Column
    lower: Column
    upper: Column


@dataclass(frozen=True)
class Weights:
    """Weights of the squared errors of position in 1/s⁶ and speed in 1/s⁴, relative to the squared jerk."""

    position: Scalar
    speed: Scalar


@dataclass(frozen=True)
class VehicleMotion:
    """Position in m, speed in m/s and acceleration in m/s² of the vehicle now."""

    x: Scalar
    v: Scalar
    a: Scalar


def cost_of_changes(predicted: Prediction, weights: Weights) -> Matrix:
    """(n, n) Hessian of the cost in changes of acceleration at the ends of stages; it depends on the weights alone."""
    position, speed = predicted.of_position, predicted.of_speed
    count = predicted.weights
    at_end = _at_end(predicted)
    total = times(transpose(at_end), cost_to_go(weights.position, weights.speed), at_end)
    for weight, form in (
        (weights.position, position.T @ (count[:, None] * position)),
        (weights.speed, speed.T @ (count[:, None] * speed)),
        (1.0, predicted.of_change),
    ):
        total = plus(total, tuple(tuple(weight * value for value in row) for row in form.tolist()))
    return total


def slope_of_cost(
    predicted: Prediction, weights: Weights, now: VehicleMotion, ahead: Sequence[Setpoint], lost: Sequence[Scalar]
) -> Column:
    """(n,) gradient of the cost at a constant force, from the present motion and the (n,) setpoints ahead.

    `lost` (n,) are decelerations in m/s² there by the change of resistance.
    """
    t, n = predicted.times.tolist(), range(len(ahead))
    e = [
        now.x + t[k] * (now.v + t[k] / 2 * now.a) - point.x - by
        for k, point, by in zip(n, ahead, _times(predicted.of_position, lost), strict=True)
    ]
    w = [
        now.v + t[k] * now.a - point.v - by
        for k, point, by in zip(n, ahead, _times(predicted.of_speed, lost), strict=True)
    ]
    last = e[-1], w[-1], now.a - lost[-1] - ahead[-1].a
    at_end = times(transpose(_at_end(predicted)), cost_to_go(weights.position, weights.speed))
    count = predicted.weights[:, None]
    of_e = _times((count * predicted.of_position).T, [weights.position * value for value in e])
    of_w = _times((count * predicted.of_speed).T, [weights.speed * value for value in w])
    terminal_products = [dot(row, last) for row in at_end]
    return tuple(sum(values) for values in zip(of_e, of_w, terminal_products, strict=True))


def room(predicted: Prediction, a: Scalar, limit: Scalar, rate: Scalar) -> tuple[Column, Column]:
    """(n,) lowest and highest change of acceleration at the ends of stages, by the limits of force and rate.

    The force causes the acceleration `a` now and at most `limit`, both in m/s², which changes at most at `rate` in
    m/s³.
    """
    reach = [rate * t for t in predicted.times.tolist()]
    return tuple(maximum(-limit - a, -by) for by in reach), tuple(minimum(limit - a, by) for by in reach)


def _at_end(predicted: Prediction) -> Matrix:
    """(3, n) errors of position, speed and acceleration at the horizon's end, per change of acceleration."""
    n = len(predicted.times)
    rows = np.vstack([predicted.of_position[-1], predicted.of_speed[-1], np.eye(n)[-1]])
    return tuple(map(tuple, rows.tolist()))


def _times(matrix: NDArray[np.float64], column: Sequence[Scalar]) -> list[Scalar]:
    """A matrix of numbers times a column, without the products with zero."""
    return [sum(x * y for x, y in zip(row, column, strict=True) if x) for row in matrix.tolist()]
