"""A linear extended state observer: position, speed and disturbance acceleration from the position alone.

All its poles lie at ``-bandwidth``, after Gao, "Scaling and bandwidth-parameterization based controller tuning"
(American Control Conference 2003, 4989). It is the discrete current one of Miklosovic, Radke and Gao (American Control
Conference 2006), whose poles lie at ``exp(-bandwidth * sample_time)`` exactly; it is stable for every bandwidth.
"""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.controllers.parts import Estimate, PositionOutput
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, exp, where


@dataclass(frozen=True)
class ExtendedState:
    """What the observer expects of the coming sample."""

    x: Annotated[Scalar, Quantity("m", "expected position"), Mark.POSITION] = 0.0
    v: Annotated[Scalar, Quantity("m/s", "expected speed"), Mark.SPEED] = 0.0
    d: Annotated[Scalar, Quantity("m/s^2", "expected disturbance acceleration")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0


@dataclass(frozen=True)
class ObserverOutput(PositionOutput):
    """What a law with such an observer gives."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]


def corrected(
    state: ExtendedState, estimate: Estimate, bandwidth: Scalar, sample_time: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Position in m, speed in m/s and disturbance acceleration in m/s² of this sample; at the first, as estimated."""
    T = sample_time
    pole = exp(-bandwidth * T)
    innovation = where(state.primed, estimate.x - state.x, 0.0)
    x = where(state.primed, state.x, estimate.x) + (1 - pole**3) * innovation
    v = where(state.primed, state.v, estimate.v) + 1.5 * (1 - pole) ** 2 * (1 + pole) / T * innovation
    d = state.d + (1 - pole) ** 3 / T**2 * innovation
    return x, v, d


def expected(x: Scalar, v: Scalar, d: Scalar, acceleration: Scalar, sample_time: Scalar) -> ExtendedState:
    """What position in m, speed in m/s and disturbance in m/s² will be a sample later, at an acceleration in m/s²."""
    T = sample_time
    return ExtendedState(x=x + T * v + T**2 / 2 * acceleration, v=v + T * acceleration, d=d, primed=1.0)
