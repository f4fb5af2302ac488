"""Fuzzy adaptive nonlinear disturbance observer, FANDO (paper Section 3.1.3, E6), and its fuzzy logic system (A8).

The discretisation needs no acceleration sensor: the difference quotient of the speed error over the last sample, less
the acceleration of the last command, is the disturbance of that sample.

The fuzzy logic system raises the observer's gain when its error is large or changes fast. Two inputs in [−1, 1], five
triangular labels each (a partition of unity), product inference, zero-order Sugeno. The rule base treats NB like PB and
NS like PS, so that the magnitudes of the inputs with the labels ZO, PS, PB suffice.
"""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Tunable
from dualwinch.model.scalar import Scalar, absolute, exp, maximum, minimum

RULES = (
    (0.0, 0.25, 0.5),
    (0.5, 0.5, 0.75),
    (1.0, 1.0, 1.0),
)
"""Singletons; row = label of the error's magnitude, column = label of its rate's: zero, small, big (A8)."""


def memberships(value: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Degrees of membership in zero, small and big of an input's magnitude, limited to 1; they sum to one."""
    twice = 2 * minimum(absolute(value), 1.0)
    return maximum(1 - twice, 0.0), minimum(twice, 2 - twice), maximum(twice - 1, 0.0)


def _mean(values: tuple[Scalar, Scalar, Scalar], degrees: tuple[Scalar, Scalar, Scalar]) -> Scalar:
    """Mean of the labels' values, weighted by the degrees, which sum to one."""
    zero, small, big = values
    return zero + (small - zero) * degrees[1] + (big - zero) * degrees[2]


def inference(error: Scalar, rate: Scalar) -> Scalar:
    """FLS(error, rate) in [0, 1] of two dimensionless inputs (paper Section 3.1.3, A8)."""
    of_rate = memberships(rate)
    zero, small, big = (_mean(row, of_rate) for row in RULES)
    return _mean((zero, small, big), memberships(error))


@dataclass(frozen=True)
class ObserverGains:
    """Gains of the disturbance observer."""

    l0: Annotated[NonNegative, Quantity("1/s", "constant part of the observer gain, L_0", "A9"), Tunable(0.1, 100)] = (
        5.0
    )
    kf: Annotated[NonNegative, Quantity("1/s", "fuzzy part of the observer gain, K_f", "A9"), Tunable(0.1, 100)] = 5.0
    error_scale: Annotated[
        Positive, Quantity("m/s^2", "estimation error that counts as big", "A8"), Tunable(1e-3, 10, standard=False)
    ] = 0.1
    rate_scale: Annotated[
        Positive,
        Quantity("m/s^3", "rate of the estimation error that counts as big", "A8"),
        Tunable(1e-2, 100, standard=False),
    ] = 0.5
    filter_time: Annotated[
        NonNegative,
        Quantity("s", "low-pass on the estimation error before the fuzzy rules", "A8"),
        Tunable(1e-3, 2, standard=False),
    ] = 0.2


@dataclass(frozen=True)
class ObserverState:
    """State of the observer."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")] = 0.0
    filtered: Annotated[Scalar, Quantity("m/s^2", "low-passed estimation error")] = 0.0
    e2_previous: Annotated[Scalar, Quantity("m/s", "speed error of the last sample")] = 0.0
    a_previous: Annotated[Scalar, Quantity("m/s^2", "error acceleration of the last command")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0


@dataclass(frozen=True)
class DisturbanceEstimate:
    """Output of the observer in one sample."""

    d_hat: Scalar
    L1: Scalar
    filtered: Scalar


def estimate_disturbance(
    state: ObserverState, e2: Scalar, gains: ObserverGains, sample_time: Scalar
) -> DisturbanceEstimate:
    """New estimate of the disturbance acceleration from the speed error e2 in m/s (paper Section 3.1.3, E6)."""
    d_tilde = state.primed * ((e2 - state.e2_previous) / sample_time - state.a_previous - state.d_hat)
    step = sample_time / (gains.filter_time + sample_time) * (d_tilde - state.filtered)
    filtered = state.filtered + step
    fuzzy = inference(filtered / gains.error_scale, step / sample_time / gains.rate_scale)
    L1 = gains.l0 + gains.kf * fuzzy
    return DisturbanceEstimate(state.d_hat + (1 - exp(-L1 * sample_time)) * d_tilde, L1, filtered)


def remember(now: DisturbanceEstimate, e2: Scalar, error_acceleration: Scalar) -> ObserverState:
    """State for the next sample, from the speed error e2 in m/s and the output of this one.

    The error acceleration ë_1 in m/s² is that of the saturated command without disturbance.
    """
    return ObserverState(now.d_hat, now.filtered, e2, error_acceleration, 1.0)
