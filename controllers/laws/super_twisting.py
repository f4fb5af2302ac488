"""Super-twisting position control: a second-order sliding mode with a continuous force.

On the linear surface ``s = e1 + e2/lam`` the algorithm of Levant (Int. J. Control 58 (1993) 1247) imposes::

    ds/dt = -k1 |s|^(1/2) sign(s) + z + d/lam,      dz/dt = -k2 sign(s)

so that z compensates a disturbance d of bounded slope ``|dd/dt| <= lam L`` without an observer; k1 = 1.5 sqrt(L) and
k2 = 1.1 L are the usual choice. Moreno and Osorio (IEEE CDC 2008, 2856) prove it with a strict Lyapunov function.
Nominal model and anti-saturation system are those of the sliding mode of the paper (Sections 3.1.1, 3.1.2).

Our additions: both odd powers are smoothed near zero (as in A7) against chatter by sampling, and z is held while the
force is beyond its limit.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains, auxiliary_update
from dualwinch.controllers.laws.nftsm import NftsmOutput, odd_power
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, where


@dataclass(frozen=True)
class SuperTwistingState:
    """State of the law."""

    z: Annotated[Scalar, Quantity("m/s", "integral part")] = 0.0
    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")] = 0.0


@dataclass(frozen=True)
class SuperTwisting(PositionLaw):
    """The law, its gains and the anti-saturation system."""

    lam: Annotated[
        Positive, Quantity("1/s", "rate at which the error decays on the surface", "by hand"), Tunable(0.1, 20)
    ] = 2.0
    k1: Annotated[NonNegative, Quantity("m^(1/2)/s", "gain of the square root", "by hand"), Tunable(0.01, 20)] = 0.5
    k2: Annotated[NonNegative, Quantity("m/s^2", "gain of the integral", "by hand"), Tunable(1e-3, 20)] = 0.2
    smoothing: Annotated[
        Positive,
        Quantity("m", "sliding variable below which root and sign are smoothed", "by hand"),
        Tunable(1e-5, 0.1, standard=False),
    ] = 1e-3
    auxiliary: AuxiliaryGains = field(default_factory=AuxiliaryGains)

    kind: ClassVar = "super-twisting"
    label: ClassVar = "Super-twisting"
    colour: ClassVar = "#CC79A7"
    dashes: ClassVar = (0, (3, 1, 1, 1, 1, 1))

    def initial_state(self) -> SuperTwistingState:
        """Zero state."""
        return SuperTwistingState()

    def step(
        self, state: SuperTwistingState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[SuperTwistingState, NftsmOutput]:
        """One sample of the law."""
        auxiliary, Z_a, sample_time = self.auxiliary, state.Z_a, context.sample_time
        forces = nominal_forces(estimate.v, estimate.d, context.nominal)
        e1, e2 = estimate.x - setpoint.x, estimate.v - setpoint.v
        s = e1 + (e2 + auxiliary.gamma * Z_a) / self.lam
        reaching = state.z - self.k1 * odd_power(s, 0.5, self.smoothing)
        u = forces.mass * (setpoint.a + self.lam * (reaching - e2)) + forces.resistance - auxiliary.gamma_force * Z_a
        u_sat = context.limits.clipped(u)
        z = state.z - sample_time * self.k2 * odd_power(s, 0.0, self.smoothing)
        next_state = SuperTwistingState(
            z=where(u == u_sat, z, state.z), Z_a=auxiliary_update(Z_a, u - u_sat, auxiliary, sample_time)
        )
        return next_state, NftsmOutput(u=u, u_sat=u_sat, Z_a=Z_a, s=s)
