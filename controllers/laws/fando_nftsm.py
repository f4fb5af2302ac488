"""The paper's position controller: sliding mode with the fuzzy adaptive disturbance observer (Section 3.1.4)."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dualwinch.controllers.laws.auxiliary import auxiliary_update
from dualwinch.controllers.laws.nftsm import NftsmState, nftsm_control, nominal_forces
from dualwinch.controllers.laws.observer import ObserverState, estimate, remember
from dualwinch.controllers.signals import PositionOutput, Seen
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class FandoNftsmState:
    """State of the law and its observer."""

    nftsm: NftsmState = field(default_factory=NftsmState)
    observer: ObserverState = field(default_factory=ObserverState)


def fando_nftsm_step(
    state: FandoNftsmState,
    measurement: Seen,
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[FandoNftsmState, PositionOutput]:
    """One sample: estimate the disturbance, compensate it, remember what was asked for (paper Section 3.1.4)."""
    e2 = measurement.v - setpoint.v
    now = estimate(state.observer, e2, controller.observer, sample_time)
    Z_a = state.nftsm.Z_a
    u, u_sat, s = nftsm_control(Z_a, now.d_hat, measurement, setpoint, controller, nominal)
    forces = nominal_forces(measurement.v, measurement.d, nominal)
    error_acceleration = (u_sat - forces.resistance) / forces.mass - setpoint.a
    next_state = FandoNftsmState(
        nftsm=NftsmState(auxiliary_update(Z_a, u - u_sat, controller.auxiliary, sample_time)),
        observer=remember(now, e2, error_acceleration),
    )
    return next_state, PositionOutput(u=u, u_sat=u_sat, d_hat=now.d_hat, L1=now.L1, Z_a=Z_a, s=s)
