"""Late sensors: readings of what was true a delay ago, from a memory of the last samples.

Between samples the remembered signals are taken as linear in time. A late signal is their interpolation; a late
position or angle is the present one less the integral of the remembered speeds over the delay, which is exact for
piecewise linear speeds. Both are sums over the memory whose weights are continuous in the delay, so that the delay is a
number of the compiled code, and the length of the memory alone shapes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from dualwinch.model.quantities.quantity import Mark, Quantity, vector
from dualwinch.model.scalar import Scalar, absolute, clip, maximum


@dataclass(frozen=True)
class PastMotion:
    """The vehicle's speeds at the last samples, the latest first."""

    v: Annotated[Any, Quantity("m/s", "speed of the vehicle at an earlier sample"), Mark.SPEED]


@dataclass(frozen=True)
class PastTurns:
    """Speeds of both motors' shafts at the last samples, as at the drums, the latest first."""

    omega_1: Annotated[Any, Quantity("rad/s", "speed of drum 1 at an earlier sample")]
    omega_2: Annotated[Any, Quantity("rad/s", "speed of drum 2 at an earlier sample")]


@dataclass(frozen=True)
class PastPulls:
    """Tensions that both load cells felt at the last samples, the latest first."""

    F1: Annotated[Any, Quantity("N", "tension at load cell 1 at an earlier sample")]
    F2: Annotated[Any, Quantity("N", "tension at load cell 2 at an earlier sample")]


def filled(value: Scalar, length: int) -> Any:
    """A memory of a value that has been the same for a `length` in samples."""
    return vector([value] * length)


def remembered(now: Scalar, memory: Any) -> Any:
    """The memory of the next sample."""
    return vector([now, *_values(memory)[:-1]])


def value_before(delay: Scalar, now: Scalar, memory: Any) -> Scalar:
    """The value a delay in samples ago, interpolated linearly."""
    values = [now, *_values(memory)]
    return sum(maximum(1 - absolute(delay - age), 0.0) * value for age, value in enumerate(values))


def change_since(delay: Scalar, now: Scalar, memory: Any, sample_time: Scalar) -> Scalar:
    """Integral of remembered rates from a delay in samples ago until now, by the trapezoidal rule.

    >>> round(change_since(1.5, 3.0, filled(1.0, 4), 0.1), 12)
    0.25
    """
    weights = [_hat_integral(delay - age) - _hat_integral(-age) for age in range(len(_values(memory)) + 1)]
    values = [now, *_values(memory)]
    return sample_time * sum(weight * value for weight, value in zip(weights, values, strict=True))


def _values(memory: Any) -> Sequence[Scalar]:
    return [memory[index] for index in range(memory.shape[0])]


def _hat_integral(end: Scalar) -> Scalar:
    """Integral of the hat function 1 − |s| from −1 to `end`."""
    reach = clip(end, -1.0, 1.0)
    return 0.5 + reach - reach * absolute(reach) / 2
