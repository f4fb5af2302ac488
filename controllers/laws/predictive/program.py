"""The quadratic program of a sample: which changes of force over the horizon cost least."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.laws.predictive.cost_to_go import cost_to_go
from dualwinch.controllers.laws.predictive.prediction import Prediction
from dualwinch.model.matrix import Matrix, plus, times, transpose
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, maximum, minimum

Column = tuple[Scalar, ...]


class Program(NamedTuple):
    """The least of ``y' quadratic y / 2 + linear' y`` for ``lower <= y <= upper``.

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
    """What errors cost beside the square of the jerk, 1: of the position in 1/s⁶, of the speed in 1/s⁴."""

    position: Scalar
    speed: Scalar


@dataclass(frozen=True)
class Motion:
    """Position in m, speed in m/s and acceleration in m/s² of the vehicle now."""

    x: Scalar
    v: Scalar
    a: Scalar


def cost_of_changes(predicted: Prediction, weights: Weights) -> Matrix:
    """(n, n) what changes of acceleration at the ends of stages cost, twice; it depends on the weights alone."""
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
    predicted: Prediction, weights: Weights, now: Motion, ahead: Sequence[Setpoint], lost: Sequence[Scalar]
) -> Column:
    """(n,) slope of the cost where the force stays as it is.

    Args:
        predicted: the horizon.
        weights: of the errors.
        now: where the vehicle is and how it moves.
        ahead: setpoints at the ends of the stages.
        lost: (n,) acceleration in m/s² that resistance takes there, beyond what it takes now.
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
    beyond = [sum(x * y for x, y in zip(row, last, strict=True)) for row in at_end]
    return tuple(sum(values) for values in zip(of_e, of_w, beyond, strict=True))


def room(predicted: Prediction, a: Scalar, limit: Scalar, rate: Scalar) -> tuple[Column, Column]:
    """(n,) lowest and highest change of acceleration at the ends of stages that force and rate allow.

    Args:
        predicted: the horizon.
        a: acceleration in m/s² that the force gives now.
        limit: largest acceleration in m/s² that it can give.
        rate: largest change of that in m/s³.
    """
    reach = [rate * t for t in predicted.times.tolist()]
    return tuple(maximum(-limit - a, -by) for by in reach), tuple(minimum(limit - a, by) for by in reach)


def _at_end(predicted: Prediction) -> Matrix:
    """(3, n) errors of position, speed and acceleration at the horizon's end, by changes of acceleration."""
    n = len(predicted.times)
    rows = np.vstack([predicted.of_position[-1], predicted.of_speed[-1], np.eye(n)[-1]])
    return tuple(map(tuple, rows.tolist()))


def _times(matrix: NDArray[np.float64], column: Sequence[Scalar]) -> list[Scalar]:
    """A matrix of numbers times a column, without what is zero."""
    return [sum(x * y for x, y in zip(row, column, strict=True) if x) for row in matrix.tolist()]
