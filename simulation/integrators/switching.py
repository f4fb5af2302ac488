"""The parts of a step in which a rope goes slack or tight (docs/exponential-integrator.md): flight, series, crossing.

Time is counted in steps here.
"""

from dualwinch.model.scalar import Scalar, absolute, clip, maximum, sqrt, where

SERIES_ORDER = 8
"""Order of the power series that carries a taut rope over a part of a step."""

TINY = 1e-100
"""Floor under square roots and divisors on branches not taken; small, yet its square and its slope are numbers."""


def free_flight(
    stretch: Scalar, rate: Scalar, g: Scalar, ramp: Scalar, drag: Scalar, t: Scalar
) -> tuple[Scalar, Scalar]:
    """Stretch and rate at the time t of a slack rope, s'' = g + ramp t − drag s' (Eq. 20, 21)."""
    z = drag * t
    scale = 1 / (60 + z * (36 + z * (9 + z)))
    once = t * (60 + z * (6 + z)) * scale
    twice = t**2 * (30 + z * (8 + z)) * scale
    thrice = t**3 * (10 + z * (3.5 + 0.5 * z)) * scale
    kept = (60 + z * (3 * z - 24)) * scale
    return stretch + once * rate + twice * g + thrice * ramp, kept * rate + once * g + twice * ramp


def taut_series(
    stretch: Scalar, rate: Scalar, g: Scalar, ramp: Scalar, kappa: Scalar, damping: Scalar, t: Scalar
) -> tuple[Scalar, Scalar]:
    """Stretch and rate at the time t of a taut rope, s'' = g + ramp t − kappa s − damping s', as series (Eq. 23)."""
    first, second = rate, g - kappa * stretch - damping * rate
    moved_stretch, moved_rate, power = stretch + t * rate, rate, t
    for order in range(2, SERIES_ORDER + 1):
        moved_rate = moved_rate + second * power
        power = power * t / order
        moved_stretch = moved_stretch + second * power
        first, second = second, (ramp if order == 2 else 0.0) - kappa * first - damping * second
    return moved_stretch, moved_rate


def crossing(start: Scalar, slope: Scalar, end: Scalar) -> Scalar:
    """Time in [0, 1] at which the parabola with this start, slope at the start and end changes its sign (Eq. 22)."""
    bend = 2 * (end - start - slope)
    root = sqrt(maximum(slope**2 - 2 * bend * start, TINY))
    towards_zero = where(start > 0, -slope, slope)
    return clip(2 * absolute(start) / maximum(towards_zero + root, TINY), 0.0, 1.0)
