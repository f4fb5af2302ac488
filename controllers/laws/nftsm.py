"""Nonsingular fast terminal sliding-mode position control with anti-saturation (paper Sections 3.1.1, 3.1.2, 3.1.4).

The sliding variable ``s = e1 + sig(z, p/q)/beta`` with ``z = e2 + gamma Z_a`` contains a power of the speed error, so
that the slope of the reaching law grows as ``|e2|^(p/q − 1)``. Drums that oscillate on their ropes tolerate a bounded
slope (`analysis.resonance`): after a push that leaves a large speed error, a stiff law keeps them oscillating until the
error has faded. With ``linear_speed = v`` the boundary layer widens with the speed error
(time-varying boundary layer, Slotine and Li 1991, Section 7.2), and the exponential rate falls alike::

    w = (1 + (z/v)²)^((p/q − 1)/2),    reaching = eta s/w + k sat(s/(w phi))

Below v this is the paper's law; above, ``s/w`` is linear in the speed error. The surface, and with it the motion
towards the reference, remains. The law cancels the drift of s, and its Lyapunov function ``V = s²/2`` decreases for any
w > 0::

    dV/dt = −sig'(z)/beta (eta s²/w + k s sat(s/(w phi))) <= 0

A disturbance d leaves ``|s| <= w phi |d|/k`` instead of ``phi |d|/k``: the same for small speed errors.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains, auxiliary_update
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Rule, Tunable, TunableRatio
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, is_odd, power, present


@dataclass(frozen=True)
class NftsmGains:
    """Gains of the sliding-mode law; p and q odd, p > q."""

    beta: Annotated[
        Positive, Quantity("m^(p/q-1)/s^(p/q)", "weight of the position error", "paper 4.1"), Tunable(0.005, 5)
    ] = 0.05
    eta: Annotated[
        NonNegative, Quantity("1/s^2", "rate of the exponential reaching law", "paper 4.1"), Tunable(0.005, 50)
    ] = 0.05
    k: Annotated[NonNegative, Quantity("m/s^2", "gain of the switching term", "paper 4.1"), Tunable(0.01, 20)] = 0.5
    phi: Annotated[Positive, Quantity("m", "thickness of the boundary layer", "paper 4.1"), Tunable(0.005, 5)] = 0.5
    p: Annotated[
        int,
        at.Ge(3),
        Quantity("1", "numerator of the surface's power, odd", "paper 4.1"),
        TunableRatio("q", ("11/9", "9/7", "7/5", "5/3", "9/5")),
    ] = 5
    q: Annotated[int, at.Ge(1), Quantity("1", "denominator of the surface's power, odd", "paper 4.1")] = 3
    smoothing: Annotated[
        Positive,
        Quantity("m/s", "speed error below which the odd power is smoothed", "A7"),
        Tunable(1e-5, 1e-2, standard=False),
    ] = 1e-5
    linear_speed: Annotated[
        NonNegative,
        Quantity("m/s", "speed error above which the reaching law is linear; 0: none", "Slotine and Li 1991"),
        Tunable(3e-3, 1e-1, standard=False),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0

    rules: ClassVar = (
        Rule(("p",), lambda gains: is_odd(gains.p), lambda *_: "must be odd"),
        Rule(("q",), lambda gains: is_odd(gains.q), lambda *_: "must be odd"),
        Rule(("p", "q"), lambda gains: gains.p > gains.q, lambda gains, table: f"must be > {table}q = {gains.q}"),
    )


@dataclass(frozen=True)
class NftsmState:
    """State of the law without an observer."""

    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")] = 0.0


@dataclass(frozen=True)
class NftsmOutput(PositionOutput):
    """Output of the law."""

    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")]
    s: Annotated[Scalar, Quantity("m", "sliding variable")]


def odd_power(value: Scalar, exponent: Scalar, smoothing: Scalar) -> Scalar:
    """sign(z) |z|^a, smoothed near zero: its slope there is infinite for a < 1 and chatters when sampled (A7)."""
    return value * power(value**2 + smoothing**2, (exponent - 1) / 2)


def layer_width(speed_error: Scalar, gains: NftsmGains) -> Scalar:
    """Thickness of the boundary layer at a speed error in m/s, over that at none: ``(1 + (z/v)²)^((p/q − 1)/2)``.

    Example:
        >>> f"{layer_width(0.08, NftsmGains(linear_speed=0.01)):.2f}, {layer_width(0.08, NftsmGains()):.2f}"
        '4.02, 1.00'
    """
    if not present(gains.linear_speed):
        return 1.0
    return power(1 + (speed_error / gains.linear_speed) ** 2, (gains.p / gains.q - 1) / 2)


@dataclass(frozen=True)
class Nftsm(PositionLaw):
    """The law without an observer, and the anti-saturation system."""

    nftsm: NftsmGains = field(default_factory=NftsmGains)
    auxiliary: AuxiliaryGains = field(default_factory=AuxiliaryGains)

    kind: ClassVar = "nftsm"
    label: ClassVar = "NFTSM"
    colour: ClassVar = "#D55E00"
    dashes: ClassVar = (0, (5, 2))

    def initial_state(self) -> NftsmState:
        """Zero state."""
        return NftsmState()

    def control(
        self, Z_a: Scalar, d_hat: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Force u, its saturated value u_sat (N) and the sliding variable s (m) (paper Section 3.1.4, E7, E8).

        Uses the anti-saturation state Z_a in N s and the observer's estimate d_hat in m/s², 0 without an observer.
        """
        gains, auxiliary = self.nftsm, self.auxiliary
        forces = nominal_forces(estimate.v, estimate.d, context.nominal)
        e1, e2 = estimate.x - setpoint.x, estimate.v - setpoint.v
        ratio = gains.p / gains.q
        z = e2 + auxiliary.gamma * Z_a
        s = e1 + odd_power(z, ratio, gains.smoothing) / gains.beta
        terminal = gains.beta / ratio * odd_power(e2, 2 - ratio, gains.smoothing)
        distance = s / layer_width(z, gains)
        reaching = gains.eta * distance + gains.k * clip(distance / gains.phi, -1.0, 1.0)
        u = forces.mass * (setpoint.a - terminal - reaching - d_hat) + forces.resistance - auxiliary.gamma_force * Z_a
        return u, context.limits.clipped(u), s

    def step(
        self, state: NftsmState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[NftsmState, NftsmOutput]:
        """One sample, with d_hat = 0."""
        u, u_sat, s = self.control(state.Z_a, 0.0, estimate, setpoint, context)
        Z_a = auxiliary_update(state.Z_a, u - u_sat, self.auxiliary, context.sample_time)
        return NftsmState(Z_a), NftsmOutput(u=u, u_sat=u_sat, Z_a=state.Z_a, s=s)
