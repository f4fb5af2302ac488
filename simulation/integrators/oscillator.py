"""One rope and its drum over a step: a damped oscillation in closed form while taut, free motion while slack.

Where the rope goes slack or tight within the step, the moment is located as the root of a parabola, and a power series
gives the taut part. Equations are those of docs/accuracy.md. The unit of time is the step, which avoids
products with its length: rates are in m/step, and so on.
"""

import math
from dataclasses import dataclass
from functools import cached_property

from dualwinch.model.scalar import Scalar, absolute, clip, exp, maximum, minimum, reciprocals, sqrt, where

DOUBLINGS = 3
"""Doublings of the angle in `twice_cosine_and_sine`: its error is 5e-10 up to one oscillation, 3e-6 up to two."""

ANGLE_ORDER = 5
"""Terms of its series after the first."""


def twice_cosine_and_sine(square: Scalar) -> tuple[Scalar, Scalar]:
    """2 cos(r) and 2 sin(r)/r from r², which may be negative (then cosh and sinh), by products only.

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
    """exp(z) to second order, for the small change of a rope's stiffness in a step."""
    return 1 + z * (1 + z / 2)


@dataclass(frozen=True)
class Swing:
    """The flow over one step of s'' = g + ramp t − kappa w s − damping s', with w = 1 + stiffening (t − 1/2).

    The rope gets stiffer or softer as it gets shorter or longer. The oscillating variable is q = w s, the spring force
    over the stiffness at mid-step, whose equilibrium is constant (Eq. 6, 7).

    Attributes:
        kappa: square of the frequency of q (Eq. 7).
        q_of_q, q_of_rate, rate_of_rate: flow of q and its rate; the element from q to its rate is −kappa q_of_rate
            (Eq. 9).
        q_of_drive, q_of_ramp: response of q to unit g and unit ramp; those of its rate are `q_of_rate` and
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
    """The flow of a taut rope and its drum over a step.

    `kappa` is the square of the frequency at mid-step, the damping that of rope and winch friction, `stiffening` the
    relative rate of the stiffness.
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


SERIES_ORDER = 8
"""Order of the power series of a taut rope over a part of a step."""

TINY = 1e-100
"""Lower bound of radicands and divisors on branches not taken; small, yet with finite square and slope."""


def free_flight(
    stretch: Scalar, rate: Scalar, g: Scalar, ramp: Scalar, drag: Scalar, t: Scalar
) -> tuple[Scalar, Scalar]:
    """Stretch and rate at the time t of a slack rope, s'' = g + ramp t − drag s' (Eq. 20, 21)."""
    z = drag * t
    scale = 1 / (60 + z * (36 + z * (9 + z)))
    once = t * (60 + z * (6 + z)) * scale
    twice = t**2 * (30 + z * (8 + z)) * scale
    thrice = t**3 * (10 + z * (3.5 + 0.5 * z)) * scale
    remainder = (60 + z * (3 * z - 24)) * scale
    return stretch + once * rate + twice * g + thrice * ramp, remainder * rate + once * g + twice * ramp


def taut_series(
    stretch: Scalar, rate: Scalar, g: Scalar, ramp: Scalar, kappa: Scalar, damping: Scalar, t: Scalar
) -> tuple[Scalar, Scalar]:
    """Stretch and rate at the time t of a taut rope, s'' = g + ramp t − kappa s − damping s', as series (Eq. 23)."""
    slope, curvature = rate, g - kappa * stretch - damping * rate
    moved_stretch, moved_rate, power = stretch + t * rate, rate, t
    for order in range(2, SERIES_ORDER + 1):
        moved_rate = moved_rate + curvature * power
        power = power * t / order
        moved_stretch = moved_stretch + curvature * power
        slope, curvature = curvature, (ramp if order == 2 else 0.0) - kappa * slope - damping * curvature
    return moved_stretch, moved_rate


def crossing(start: Scalar, slope: Scalar, end: Scalar) -> Scalar:
    """Time in [0, 1] at which the parabola with this start, slope at the start and end changes its sign (Eq. 22)."""
    bend = 2 * (end - start - slope)
    root = sqrt(maximum(slope**2 - 2 * bend * start, TINY))
    towards_zero = where(start > 0, -slope, slope)
    return clip(2 * absolute(start) / maximum(towards_zero + root, TINY), 0.0, 1.0)


@dataclass(frozen=True)
class Oscillator:
    """A rope and its drum: stretch'' = drive + sign a (1 + drag t) − mobility F − drag stretch' (Eq. 3).

    F = spring stretch + damper stretch' is the tension. Winch friction brakes the drum, not the stretch, hence the
    term that grows in time with the vehicle's acceleration a.

    Lengths are in m, forces in N, times in steps.

    Attributes:
        stretch, rate: stretch and its rate at the beginning.
        drive: acceleration due to motor and friction, g without a (Eq. 4).
        sign: of the vehicle's position in the stretch.
        spring, damper: of the rope at mid-step.
        compliance: 1/spring.
        stiffening: relative rate of the spring (Eq. 2).
        mobility: radius²/inertia of the drum.
        drag: slope of the winch friction over the inertia.
        slack: whether the rope can go slack; a slack rope has F = 0.
    """

    stretch: Scalar
    rate: Scalar
    drive: Scalar
    sign: float
    spring: Scalar
    compliance: Scalar
    damper: Scalar
    stiffening: Scalar
    mobility: Scalar
    drag: Scalar
    slack: bool

    @cached_property
    def _kappa(self) -> Scalar:
        return self.mobility * self.spring

    @cached_property
    def _damping(self) -> Scalar:
        return self.mobility * self.damper + self.drag

    @cached_property
    def _swing(self) -> Swing:
        return swing(self._kappa, self._damping, self.stiffening)

    def _driven(self, a: Scalar) -> tuple[Scalar, Scalar]:
        """Drive and its growth under the vehicle's acceleration a (Eq. 4)."""
        return self.drive + self.sign * a, self.drag * self.sign * a

    def _pull(self, stretch: Scalar, rate: Scalar) -> Scalar:
        """Tension of a taut rope (Eq. 5, with the spring of mid-step)."""
        return self.spring * stretch + self.damper * rate

    @cached_property
    def _taut(self) -> Scalar:
        """Whether the rope is taut at the beginning (Eq. 5)."""
        return minimum(self.stretch, self._pull(self.stretch, self.rate)) > 0

    def clearance(self, a: Scalar) -> Scalar:
        """Positive only if a taut rope stays taut throughout the step, with the vehicle's acceleration a (Eq. 27).

        The amplitude about the equilibrium is never larger than without damping, so that
        spring (equilibrium − amplitude) > damper √kappa amplitude is sufficient. Written without divisions and roots,
        times kappa/spring. It is never positive where the equilibrium is not.
        """
        kappa = self._kappa
        g, ramp = self._driven(a)
        amplitude_square = (kappa * self.stretch - g) ** 2 + kappa * self.rate**2
        amplitude_square += 10.0 * ramp**2  # times 1.1
        share = self.damper**2 * self.mobility * self.compliance  # (damper √kappa / spring)²
        return g * absolute(g) - (1.375 + 5.5 * share) * amplitude_square

    def _mean_pull(self, g: Scalar, ramp: Scalar, stretch: Scalar, rate: Scalar) -> Scalar:
        """Mean tension, from stretch and rate at the end (Eq. 15)."""
        gained = rate - self.rate + self.drag * (stretch - self.stretch)
        return (g + ramp / 2 - gained) / self.mobility

    @cached_property
    def _unaccelerated(self) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end if the rope stays taut and a is zero (Eq. 14)."""
        return self._swing.carried(self.stretch, self.rate, self.drive)

    @cached_property
    def _slopes(self) -> tuple[Scalar, Scalar]:
        """Slopes of stretch and rate at the end over a and the sign, if the rope stays taut (Eq. 14)."""
        return self._swing.driven(self.drag)

    def mean_pull(self) -> tuple[Scalar, Scalar]:
        """Mean tension as (at a = 0, slope over a and the sign), if the rope stays as it is (Eq. 15)."""
        fixed = self._mean_pull(self.drive, 0.0, *self._unaccelerated)
        stretch, rate = self._slopes
        slope = (1 + self.drag / 2 - rate - self.drag * stretch) / self.mobility
        if not self.slack:
            return fixed, slope
        return where(self._taut, fixed, 0.0), where(self._taut, slope, 0.0)

    def end(self, a: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Stretch, its rate and the mean tension at the end, with the vehicle's acceleration a (Eq. 14, 15)."""
        (stretch, rate), (stretch_slope, rate_slope) = self._unaccelerated, self._slopes
        stretch, rate = stretch + self.sign * (stretch_slope * a), rate + self.sign * (rate_slope * a)
        g, ramp = self._driven(a)
        if self.slack:
            stretch, rate = self._with_slack(g, ramp, stretch, rate)
        return stretch, rate, self._mean_pull(g, ramp, stretch, rate)

    def _with_slack(self, g: Scalar, ramp: Scalar, taut_stretch: Scalar, taut_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end, from those of a rope that stays taut: taut, slack, or switched (Eq. 5)."""
        taut = self._taut
        free_stretch, free_rate = free_flight(self.stretch, self.rate, g, ramp, self.drag, 1.0)
        stretch, rate = where(taut, taut_stretch, free_stretch), where(taut, taut_rate, free_rate)
        taut_at_end = minimum(stretch, self._pull(stretch, rate)) > 0
        switched_stretch, switched_rate = self._switched(g, ramp, stretch, rate)
        switches = taut != taut_at_end
        return where(switches, switched_stretch, stretch), where(switches, switched_rate, rate)

    def _switched(self, g: Scalar, ramp: Scalar, stretch: Scalar, rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end where the rope goes slack or tight within the step.

        The drive is g, with growth `ramp`; the given stretch and rate are those at the end without the switch.
        """
        # time of the switch (Eq. 22)
        taut = self._taut
        pull = self._pull(self.stretch, self.rate)
        acceleration = g - self.drag * self.rate - where(taut, self.mobility * pull, 0.0)
        slope = self.spring * self.rate + self.damper * acceleration
        when_pull = crossing(pull, slope, self._pull(stretch, rate))
        when_stretch = crossing(self.stretch, self.rate, stretch)
        tightens = maximum(where(self.stretch > 0, 0.0, when_stretch), where(pull > 0, 0.0, when_pull))
        when = where(taut, when_pull, tightens)

        # the taut part: first if the rope goes slack, last if it tightens (Eq. 23)
        flown = free_flight(self.stretch, self.rate, g, ramp, self.drag, when)
        start = where(taut, self.stretch, flown[0]), where(taut, self.rate, flown[1])
        g_start, lasts = where(taut, g, g + ramp * when), where(taut, when, 1.0 - when)
        stretch, rate = taut_series(*start, g_start, ramp, self._kappa, self._damping, lasts)

        # going slack: correct the moment to zero tension, then move freely (Eq. 24)
        curve = g + ramp * when - self.mobility * self._pull(stretch, rate) - self.drag * rate
        fall = self.spring * rate + self.damper * curve
        missed = clip(-self._pull(stretch, rate) / where(fall < 0, fall, -1 / TINY), -when, 1.0 - when)
        late_stretch = stretch + missed * (rate + missed * curve / 2)
        leaves = when + missed
        landed = free_flight(late_stretch, rate + missed * curve, g + ramp * leaves, ramp, self.drag, 1.0 - leaves)
        return where(taut, landed[0], stretch), where(taut, landed[1], rate)
