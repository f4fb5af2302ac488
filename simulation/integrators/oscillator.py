"""One rope and its drum over a sub-step: a damped oscillator while taut, free flight while slack."""

from dataclasses import dataclass
from functools import cached_property

from model.scalar import Scalar, absolute, both, clip, exp, maximum, sqrt, where

SERIES_ORDER = 8
"""Order of the power series that carries a taut rope over a part of a sub-step."""

DOUBLINGS = 3
"""Doublings of the angle behind `cosine_and_sine`; its series is then exact to rounding up to two oscillations."""

TINY = 1e-100
"""Floor under square roots and divisors on branches not taken; small, yet its square and its slope are numbers."""


def cosine_and_sine(square: Scalar) -> tuple[Scalar, Scalar]:
    """cos(r) and sin(r)/r from r², which may be negative (then cosh and sinh); made of products only."""
    part = square / 4**DOUBLINGS
    cosine, sine = 1.0, 1.0
    for order in range(8, 0, -1):
        cosine = 1 - part / ((2 * order - 1) * 2 * order) * cosine
        sine = 1 - part / (2 * order * (2 * order + 1)) * sine
    for _ in range(DOUBLINGS):
        cosine, sine = 2 * cosine**2 - 1, sine * cosine
    return cosine, sine


def crossing(start: Scalar, slope: Scalar, end: Scalar, h: Scalar) -> Scalar:
    """Time in [0, h] at which the parabola with this start, slope at the start and end changes its sign."""
    bend = 2 * (end - start - slope * h) / h**2
    root = sqrt(maximum(slope**2 - 2 * bend * start, TINY))
    towards_zero = where(start > 0, -slope, slope)
    return clip(2 * absolute(start) / maximum(towards_zero + root, TINY), 0.0, h)


@dataclass(frozen=True)
class Flow:
    """Linear flow over a time: stretch and rate at its end, from those at its beginning and a drive g + ramp t."""

    stretch_stretch: Scalar
    stretch_rate: Scalar
    rate_stretch: Scalar
    rate_rate: Scalar
    stretch_drive: Scalar
    rate_drive: Scalar
    stretch_ramp: Scalar
    rate_ramp: Scalar

    def __call__(self, stretch: Scalar, rate: Scalar, g: Scalar, ramp: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end."""
        driven = self.stretch_drive * g + self.stretch_ramp * ramp, self.rate_drive * g + self.rate_ramp * ramp
        return (
            self.stretch_stretch * stretch + self.stretch_rate * rate + driven[0],
            self.rate_stretch * stretch + self.rate_rate * rate + driven[1],
        )


def taut_flow(kappa: Scalar, damping: Scalar, stiffening: Scalar, h: Scalar) -> Flow:
    """Flow of s'' = g + ramp t − kappa r s − damping s' over h in s, with r growing from 1 − stiffening h/2.

    The rope gets stiffer or softer as it gets shorter or longer. The variable that swings is r s, the spring's force
    over its stiffness at mid-step: its equilibrium stays where it is.

    Args:
        kappa: square of the frequency at mid-step in 1/s².
        damping: by rope and winch friction in 1/s.
        stiffening: relative rate of the stiffness in 1/s.
        h: length of the step.
    """
    delta = damping - 2 * stiffening
    kappa = kappa - damping * stiffening
    cosine, sine = cosine_and_sine((kappa - delta**2 / 4) * h**2)
    decay = exp(-delta * h / 2)
    even, odd = decay * cosine, decay * sine * h
    force_force, force_rate, rate_rate = even + delta / 2 * odd, odd, even - delta / 2 * odd
    to_drive = (1 - force_force) / kappa
    to_ramp = (h - force_rate - delta * to_drive) / kappa
    # from s and s' to r s and (r s)', and back
    start, end = 1 - stiffening * h / 2, 1 / (1 + stiffening * h / 2)
    by_stretch = force_force * start + force_rate * stiffening, -kappa * odd * start + rate_rate * stiffening
    by_rate = force_rate * start, rate_rate * start
    turn = stiffening * end
    return Flow(
        stretch_stretch=by_stretch[0] * end,
        stretch_rate=by_rate[0] * end,
        rate_stretch=(by_stretch[1] - by_stretch[0] * turn) * end,
        rate_rate=(by_rate[1] - by_rate[0] * turn) * end,
        stretch_drive=to_drive * end,
        rate_drive=(force_rate - to_drive * turn) * end,
        stretch_ramp=to_ramp * end,
        rate_ramp=(to_drive - to_ramp * turn) * end,
    )


def free_flow(drag: Scalar, h: Scalar) -> Flow:
    """Flow of s'' = g + ramp t − drag s' over h in s, with the (2, 3) Padé form of exp(−drag h), 1 for drag = 0."""
    z = drag * h
    scale = 1 / (60 + z * (36 + z * (9 + z)))
    once = h * (60 + z * (6 + z)) * scale
    twice = h**2 * (30 + z * (8 + z)) * scale
    thrice = h**3 * (10 + z * (3.5 + 0.5 * z)) * scale
    return Flow(
        stretch_stretch=1.0,
        stretch_rate=once,
        rate_stretch=0.0,
        rate_rate=(60 + z * (3 * z - 24)) * scale,
        stretch_drive=twice,
        rate_drive=once,
        stretch_ramp=thrice,
        rate_ramp=twice,
    )


@dataclass(frozen=True)
class Oscillator:
    """stretch'' = drive + sign a (1 + drag t) − mobility F − drag stretch', F = spring stretch + damper stretch'.

    The winch friction brakes the drum, not the stretch: under the vehicle's acceleration a its share grows in time.

    Attributes:
        stretch, rate: stretch in m and its rate in m/s at the beginning.
        drive: acceleration in m/s² by motor and friction.
        sign: of the vehicle's position in the stretch.
        spring, damper: of the rope at mid-step, in N/m and N s/m.
        stiffening: relative rate of the spring in 1/s.
        mobility: radius²/inertia of the drum in 1/kg.
        drag: slope of the winch friction over the inertia in 1/s.
        h: length of the sub-step in s.
        slack: whether the rope can go slack; a slack rope has F = 0.
    """

    stretch: Scalar
    rate: Scalar
    drive: Scalar
    sign: float
    spring: Scalar
    damper: Scalar
    stiffening: Scalar
    mobility: Scalar
    drag: Scalar
    h: Scalar
    slack: bool

    @cached_property
    def _taut_flow(self) -> Flow:
        damping = self.mobility * self.damper + self.drag
        return taut_flow(self.mobility * self.spring, damping, self.stiffening, self.h)

    def _driven(self, a: Scalar) -> tuple[Scalar, Scalar]:
        return self.drive + self.sign * a, self.drag * self.sign * a

    def _pull(self, stretch: Scalar, rate: Scalar) -> Scalar:
        return self.spring * stretch + self.damper * rate

    @cached_property
    def _taut(self) -> Scalar:
        return both(self.stretch > 0, self._pull(self.stretch, self.rate) > 0)

    def clearance(self, a: Scalar) -> Scalar:
        """A bound in N below the tension all through the sub-step, with the acceleration a in m/s² and the rope taut.

        The oscillation about the equilibrium never swings further than it would without damping.
        """
        kappa = self.mobility * self.spring
        g, ramp = self._driven(a)
        equilibrium = g / kappa
        amplitude = sqrt((self.stretch - equilibrium) ** 2 + self.rate**2 / kappa) + absolute(ramp) * self.h / kappa
        return self.spring * (equilibrium - amplitude) - self.damper * sqrt(kappa) * amplitude

    def _impulse_of(self, g: Scalar, ramp: Scalar, stretch: Scalar, rate: Scalar) -> Scalar:
        gained = rate - self.rate + self.drag * (stretch - self.stretch)
        return (self.h * (g + ramp * self.h / 2) - gained) / self.mobility

    def impulse(self) -> tuple[Scalar, Scalar]:
        """Rope impulse in N s as (at a = 0, slope over a), if the rope stays as it is."""
        flow, drag, h = self._taut_flow, self.drag, self.h
        fixed = self._impulse_of(self.drive, 0.0, *flow(self.stretch, self.rate, self.drive, 0.0))
        rate, stretch = flow.rate_drive + drag * flow.rate_ramp, flow.stretch_drive + drag * flow.stretch_ramp
        slope = self.sign * (h * (1 + drag * h / 2) - rate - drag * stretch) / self.mobility
        if not self.slack:
            return fixed, slope
        return where(self._taut, fixed, 0.0), where(self._taut, slope, 0.0)

    def end(self, a: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Stretch in m, its rate in m/s and the rope impulse in N s at the end, with the acceleration a in m/s²."""
        g, ramp = self._driven(a)
        stretch, rate = self._taut_flow(self.stretch, self.rate, g, ramp)
        if self.slack:
            stretch, rate = self._with_slack(g, ramp, stretch, rate)
        return stretch, rate, self._impulse_of(g, ramp, stretch, rate)

    def _with_slack(self, g: Scalar, ramp: Scalar, taut_stretch: Scalar, taut_rate: Scalar) -> tuple[Scalar, Scalar]:
        taut = self._taut
        free_stretch, free_rate = free_flow(self.drag, self.h)(self.stretch, self.rate, g, ramp)
        stretch, rate = where(taut, taut_stretch, free_stretch), where(taut, taut_rate, free_rate)
        taut_at_end = both(stretch > 0, self._pull(stretch, rate) > 0)
        switched_stretch, switched_rate = self._switched(g, ramp, stretch, rate)
        switches = taut != taut_at_end
        return where(switches, switched_stretch, stretch), where(switches, switched_rate, rate)

    def _switched(self, g: Scalar, ramp: Scalar, stretch: Scalar, rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch and rate at the end where the rope goes slack or tight on the way.

        Args:
            g: drive in m/s².
            ramp: its growth in m/s³.
            stretch: that at the end in m, if the rope stayed as it was.
            rate: likewise, in m/s.
        """
        taut, h = self._taut, self.h
        pull = self._pull(self.stretch, self.rate)
        acceleration = g - self.drag * self.rate - where(taut, self.mobility * pull, 0.0)
        slope = self.spring * self.rate + self.damper * acceleration
        when_pull = crossing(pull, slope, self._pull(stretch, rate), h)
        when_stretch = crossing(self.stretch, self.rate, stretch, h)
        tightens = maximum(where(self.stretch > 0, 0.0, when_stretch), where(pull > 0, 0.0, when_pull))
        when = where(taut, when_pull, tightens)

        # the taut part: first if the rope goes slack, last if it tightens
        flown = free_flow(self.drag, when)(self.stretch, self.rate, g, ramp)
        start = where(taut, self.stretch, flown[0]), where(taut, self.rate, flown[1])
        g_start, lasts = where(taut, g, g + ramp * when), where(taut, when, h - when)
        stretch, rate = self._taut_series(*start, g_start, ramp, lasts)

        # going slack: move the moment to where the pull is zero, then fly
        curve = g + ramp * when - self.mobility * self._pull(stretch, rate) - self.drag * rate
        fall = self.spring * rate + self.damper * curve
        missed = clip(-self._pull(stretch, rate) / where(fall < 0, fall, -1 / TINY), -when, h - when)
        late_stretch = stretch + missed * (rate + missed * curve / 2)
        leaves = when + missed
        landed = free_flow(self.drag, h - leaves)(late_stretch, rate + missed * curve, g + ramp * leaves, ramp)
        return where(taut, landed[0], stretch), where(taut, landed[1], rate)

    def _taut_series(self, stretch: Scalar, rate: Scalar, g: Scalar, ramp: Scalar, t: Scalar) -> tuple[Scalar, Scalar]:
        kappa, delta = self.mobility * self.spring, self.mobility * self.damper + self.drag
        first, second = rate, g - kappa * stretch - delta * rate
        moved_stretch, moved_rate, power = stretch + t * rate, rate, t
        for order in range(2, SERIES_ORDER + 1):
            moved_rate = moved_rate + second * power
            power = power * t / order
            moved_stretch = moved_stretch + second * power
            first, second = second, (ramp if order == 2 else 0.0) - kappa * first - delta * second
        return moved_stretch, moved_rate
