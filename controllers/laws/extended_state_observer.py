"""A linear extended state observer: position, speed and disturbance acceleration from the position alone.

All its poles lie at ``-bandwidth``, after Gao, "Scaling and bandwidth-parameterization based controller tuning"
(American Control Conference 2003, 4989). It is the discrete current observer of Miklosovic, Radke and Gao (American
Control Conference 2006), with poles exactly at ``exp(-bandwidth * sample_time)``; it is stable for every bandwidth.
"""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.controllers.parts import Estimate, PositionOutput
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, exp, where


@dataclass(frozen=True)
class ExtendedState:
    """Predicted state of the next sample."""

    x: Annotated[Scalar, Quantity("m", "predicted position"), Mark.POSITION] = 0.0
    v: Annotated[Scalar, Quantity("m/s", "predicted speed"), Mark.SPEED] = 0.0
    d: Annotated[Scalar, Quantity("m/s^2", "predicted disturbance acceleration")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0


@dataclass(frozen=True)
class ObserverOutput(PositionOutput):
    """Output of a law with this observer."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]


def corrected(
    state: ExtendedState, estimate: Estimate, bandwidth: Scalar, sample_time: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Corrected position in m, speed in m/s and disturbance in m/s²; at the first sample those of the estimate."""
    T = sample_time
    pole = exp(-bandwidth * T)
    innovation = where(state.primed, estimate.x - state.x, 0.0)
    x = where(state.primed, state.x, estimate.x) + (1 - pole**3) * innovation
    v = where(state.primed, state.v, estimate.v) + 1.5 * (1 - pole) ** 2 * (1 + pole) / T * innovation
    d = state.d + (1 - pole) ** 3 / T**2 * innovation
    return x, v, d


def expected(x: Scalar, v: Scalar, d: Scalar, acceleration: Scalar, sample_time: Scalar) -> ExtendedState:
    """Predicted state of the next sample from position in m, speed in m/s, disturbance and acceleration in m/s²."""
    T = sample_time
    return ExtendedState(x=x + T * v + T**2 / 2 * acceleration, v=v + T * acceleration, d=d, primed=1.0)
