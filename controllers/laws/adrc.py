"""Linear active disturbance rejection: an extended state observer and a state feedback, each with one bandwidth.

After Gao, "Scaling and bandwidth-parameterization based controller tuning" (American Control Conference 2003, 4989):
all poles of the observer (`extended_state_observer`) lie at ``-observer_bandwidth``, those of the feedback at
``-control_bandwidth``.

The observer estimates position, speed and disturbance acceleration from the position and from the nominal vehicle's
acceleration by the last saturated command. It therefore does not wind up and needs no speed sensor: friction and drag
are compensated at the estimated speed.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.laws.extended_state_observer import ExtendedState, ObserverOutput, corrected, expected
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint


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

    def initial_state(self) -> ExtendedState:
        """Zero state."""
        return ExtendedState()

    def step(
        self, state: ExtendedState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[ExtendedState, ObserverOutput]:
        """One sample: correct the prediction, command a force, predict the next sample."""
        T = context.sample_time
        x, v, d = corrected(state, estimate, self.observer_bandwidth, T)
        forces = nominal_forces(v, estimate.d, context.nominal)
        proportional, derivative = self.control_bandwidth**2, 2 * self.control_bandwidth
        command = setpoint.a - proportional * (x - setpoint.x) - derivative * (v - setpoint.v)
        u = forces.mass * (command - d) + forces.resistance
        u_sat = context.limits.clipped(u)

        acceleration = (u_sat - forces.resistance) / forces.mass + d
        return expected(x, v, d, acceleration, T), ObserverOutput(u=u, u_sat=u_sat, d_hat=d)
