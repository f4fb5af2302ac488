"""Linear active disturbance rejection: an extended state observer and a state feedback, each with one bandwidth.

After Gao, "Scaling and bandwidth-parameterization based controller tuning" (American Control Conference 2003, 4989):
all poles of the observer (`extended_state_observer`) lie at ``-observer_bandwidth``, those of the feedback at
``-control_bandwidth``.

It knows position, speed and the disturbance acceleration, is fed with the position and with the acceleration that the
last saturated command would give the nominal vehicle, and so neither winds up nor needs a speed sensor: friction and
drag are compensated at the estimated speed.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.context import Context
from dualwinch.controllers.laws.extended_state_observer import ExtendedState, corrected
from dualwinch.controllers.laws.position_law import PositionLaw
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.signals import Estimate, PositionOutput
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip


@dataclass(frozen=True)
class AdrcState(ExtendedState):
    """What the observer expects."""


@dataclass(frozen=True)
class AdrcOutput(PositionOutput):
    """What the law gives."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]


@dataclass(frozen=True)
class Adrc(PositionLaw):
    """The law and its two bandwidths."""

    control_bandwidth: Annotated[
        NonNegative, Quantity("rad/s", "poles of the feedback", "by hand"), Tunable(0.2, 40)
    ] = 4.0
    observer_bandwidth: Annotated[Positive, Quantity("rad/s", "poles of the observer", "by hand"), Tunable(1, 200)] = (
        20.0
    )

    kind: ClassVar = "adrc"
    label: ClassVar = "ADRC"
    colour: ClassVar = "#56B4E9"
    dashes: ClassVar = (0, (2, 1.5))

    def initial_state(self) -> AdrcState:
        """Nothing expected."""
        return AdrcState()

    def step(
        self, state: AdrcState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[AdrcState, AdrcOutput]:
        """One sample: correct what was expected, command, expect the next sample."""
        T = context.sample_time
        x, v, d = corrected(state, estimate, self.observer_bandwidth, T)
        forces = nominal_forces(v, estimate.d, context.nominal)
        proportional, derivative = self.control_bandwidth**2, 2 * self.control_bandwidth
        wanted = setpoint.a - proportional * (x - setpoint.x) - derivative * (v - setpoint.v)
        u = forces.mass * (wanted - d) + forces.resistance
        limit = context.limits.force
        u_sat = clip(u, -limit, limit)

        acceleration = (u_sat - forces.resistance) / forces.mass + d
        following = AdrcState(x=x + T * v + T**2 / 2 * acceleration, v=v + T * acceleration, d=d, primed=1.0)
        return following, AdrcOutput(u=u, u_sat=u_sat, d_hat=d)
