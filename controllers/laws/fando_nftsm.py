"""The paper's position controller: sliding mode with the fuzzy adaptive disturbance observer (Section 3.1.4)."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from dualwinch.controllers.laws.auxiliary import AuxiliaryGains, auxiliary_update
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains, NftsmOutput, NftsmState
from dualwinch.controllers.laws.observer import ObserverGains, ObserverState, estimate_disturbance, remember
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class FandoNftsmState:
    """State of the law and its observer."""

    nftsm: NftsmState = field(default_factory=NftsmState)
    observer: ObserverState = field(default_factory=ObserverState)


@dataclass(frozen=True)
class FandoNftsmOutput(NftsmOutput):
    """Output of the law."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]
    L1: Annotated[Scalar, Quantity("1/s", "observer gain")]


@dataclass(frozen=True)
class FandoNftsm(PositionLaw):
    """The sliding-mode law, its observer and the anti-saturation system."""

    nftsm: NftsmGains = field(default_factory=NftsmGains)
    observer: ObserverGains = field(default_factory=ObserverGains)
    auxiliary: AuxiliaryGains = field(default_factory=AuxiliaryGains)

    kind: ClassVar = "fando-nftsm"
    label: ClassVar = "FANDO-NFTSM"
    colour: ClassVar = "#0072B2"
    dashes: ClassVar = "-"

    def initial_state(self) -> FandoNftsmState:
        """Zero state."""
        return FandoNftsmState()

    def step(
        self, state: FandoNftsmState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[FandoNftsmState, FandoNftsmOutput]:
        """One sample: estimate the disturbance, compensate it, store the command for the next (paper Section 3.1.4)."""
        e2 = estimate.v - setpoint.v
        now = estimate_disturbance(state.observer, e2, self.observer, context.sample_time)
        Z_a = state.nftsm.Z_a
        u, u_sat, s = Nftsm(self.nftsm, self.auxiliary).control(Z_a, now.d_hat, estimate, setpoint, context)
        forces = nominal_forces(estimate.v, estimate.d, context.nominal)
        error_acceleration = (u_sat - forces.resistance) / forces.mass - setpoint.a
        next_state = FandoNftsmState(
            nftsm=NftsmState(auxiliary_update(Z_a, u - u_sat, self.auxiliary, context.sample_time)),
            observer=remember(now, e2, error_acceleration),
        )
        return next_state, FandoNftsmOutput(u=u, u_sat=u_sat, Z_a=Z_a, s=s, d_hat=now.d_hat, L1=now.L1)
