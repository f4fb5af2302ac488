"""A taut rope and its drum over a whole step: the closed form of a damped oscillation (docs/exponential-integrator.md).

Time is counted in steps here, which spares products with their length: rates are in m a step, and so on.
"""

import math
from dataclasses import dataclass

from dualwinch.model.scalar import Scalar, exp, reciprocals

DOUBLINGS = 3
"""Doublings of the angle in `twice_cosine_and_sine`; it then errs by 5e-10 up to one oscillation, by 3e-6 up to two."""

ANGLE_ORDER = 5
"""Terms of that series beyond the first."""


def twice_cosine_and_sine(square: Scalar) -> tuple[Scalar, Scalar]:
    """2 cos(r) and 2 sin(r)/r from r², which may be negative (then cosh and sinh); made of products only.

    Eq. 12: the series at the angle over 8. Eq. 13: the doublings.
    """
    part = -square / 4**DOUBLINGS
    cosine, sine = 0.0, 0.0
    for order in range(ANGLE_ORDER, -1, -1):
        cosine = cosine * part + 2 / math.factorial(2 * order)
        sine = sine * part + 2 / 2**DOUBLINGS / math.factorial(2 * order + 1)
    for _ in range(DOUBLINGS):
        cosine, sine = cosine**2 - 2, sine * cosine
    return cosine, sine


def slow_growth(z: Scalar) -> Scalar:
    """exp(z) to the second order, for the little by which a rope's stiffness changes in a step."""
    return 1 + z * (1 + z / 2)


@dataclass(frozen=True)
class Swing:
    """The flow over one step of s'' = g + ramp t − kappa w s − damping s', with w = 1 + stiffening (t − 1/2).

    The rope gets stiffer or softer as it gets shorter or longer. The variable that swings is q = w s, the spring's
    force over its stiffness at mid-step: its equilibrium stays where it is (Eq. 6, 7).

    Attributes:
        kappa: square of the frequency of q (Eq. 7).
        q_of_q, q_of_rate, rate_of_rate: flow of q and its rate; what q gives to the rate is −kappa q_of_rate (Eq. 9).
        q_of_drive, q_of_ramp: what a unit of g and of the ramp add to q; to its rate they add `q_of_rate` and
            `q_of_drive` (Eq. 10).
        start, end: w at the beginning, 1/w at the end (Eq. 11).
        stiffening: relative rate of the stiffness (Eq. 2).
    """

    kappa: Scalar
    q_of_q: Scalar
    q_of_rate: Scalar
    rate_of_rate: Scalar
    q_of_drive: Scalar
    q_of_ramp: Scalar
    start: Scalar
    end: Scalar
    stiffening: Scalar

    def carried(self, stretch: Scalar, rate: Scalar, g: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end, from those at the beginning and a constant drive g (Eq. 9, 11)."""
        q, q_rate = self.start * stretch, self.start * rate + self.stiffening * stretch
        return self._stretch(
            self.q_of_q * q + self.q_of_rate * q_rate + self.q_of_drive * g,
            self.rate_of_rate * q_rate + self.q_of_rate * (g - self.kappa * q),
        )

    def driven(self, growth: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end, from rest and a drive 1 + growth t (Eq. 10, 11)."""
        return self._stretch(self.q_of_drive + growth * self.q_of_ramp, self.q_of_rate + growth * self.q_of_drive)

    def _stretch(self, q: Scalar, q_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate from q and its rate at the end (Eq. 11)."""
        stretch = q * self.end
        return stretch, (q_rate - self.stiffening * stretch) * self.end


def swing(kappa: Scalar, damping: Scalar, stiffening: Scalar) -> Swing:
    """The swing of a taut rope over a step.

    Args:
        kappa: square of the frequency at mid-step.
        damping: by rope and winch friction.
        stiffening: relative rate of the stiffness.
    """
    cosine, sine = twice_cosine_and_sine(kappa - damping**2 / 4 - stiffening**2)  # of the angle in Eq. 8
    kappa = kappa - damping * stiffening
    delta = damping / 2 - stiffening
    half_decay = exp(-damping / 2) / 2 * slow_growth(stiffening)  # exp(-delta)/2
    even, odd = half_decay * cosine, half_decay * sine  # C and S of Eq. 8
    skew = delta * odd
    inverse, end = reciprocals(kappa, 1 + stiffening / 2)
    q_of_drive = (1 - (even + skew)) * inverse
    return Swing(
        kappa=kappa,
        q_of_q=even + skew,
        q_of_rate=odd,
        rate_of_rate=even - skew,
        q_of_drive=q_of_drive,
        q_of_ramp=(1 - odd - 2 * delta * q_of_drive) * inverse,
        start=1 - stiffening / 2,
        end=end,
        stiffening=stiffening,
    )
