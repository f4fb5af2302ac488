"""Nonsingular fast terminal sliding-mode position control with anti-saturation (paper Sections 3.1.1, 3.1.2, 3.1.4)."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains, auxiliary_update
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Rule, Tunable, TunableRatio
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, power


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

    rules: ClassVar = (
        Rule(("p",), lambda gains: gains.p % 2 == 1, lambda *_: "must be odd"),
        Rule(("q",), lambda gains: gains.q % 2 == 1, lambda *_: "must be odd"),
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
        s = e1 + odd_power(e2 + auxiliary.gamma * Z_a, ratio, gains.smoothing) / gains.beta
        terminal = gains.beta / ratio * odd_power(e2, 2 - ratio, gains.smoothing)
        reaching = gains.eta * s + gains.k * clip(s / gains.phi, -1.0, 1.0)
        u = forces.mass * (setpoint.a - terminal - reaching - d_hat) + forces.resistance - auxiliary.gamma_force * Z_a
        return u, context.limits.clipped(u), s

    def step(
        self, state: NftsmState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[NftsmState, NftsmOutput]:
        """One sample, with d_hat = 0."""
        u, u_sat, s = self.control(state.Z_a, 0.0, estimate, setpoint, context)
        Z_a = auxiliary_update(state.Z_a, u - u_sat, self.auxiliary, context.sample_time)
        return NftsmState(Z_a), NftsmOutput(u=u, u_sat=u_sat, Z_a=state.Z_a, s=s)
