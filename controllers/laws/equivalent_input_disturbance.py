"""Equivalent-input-disturbance control: a state observer, a filtered estimate of the disturbance, a state feedback.

After She, Fang, Ohyama, Hashimoto and Wu, "Improving disturbance-rejection performance based on an
equivalent-input-disturbance approach" (IEEE Trans. Ind. Electron. 55 (2008) 380). For any disturbance of a plant, some
disturbance at its input has the same effect on the output. The observer assumes a plant without disturbance::

    dx̂/dt = A x̂ + B u_f + L (y - C x̂)

and the input equivalent to its correction is the estimate::

    d̂ = B⁺ L (y - C x̂) + u_f - u,      d̃ = F(s) d̂,      u = u_f - d̃

with a first-order low-pass filter F, which sets the bandwidth of disturbance rejection.

Here the output is the position and the input the acceleration of the nominal vehicle, less its resistance. The observer
is the discrete current one with both poles at ``exp(-observer_bandwidth * sample_time)``; the left inverse of B uses
the speed alone, so that ``d̂ = d̃ + (correction of the speed)/(sample time)``. In continuous time observer and filter
together have the poles of ``s³ + 2 w s² + w² s + w²/filter_time`` with w the observer's bandwidth, stable for
``filter_time > 1/(2 w)``. Linear active disturbance rejection has all three poles in one place
(`controllers.laws.adrc`); here the filter is separate. The observer uses the saturated command: it does not wind up,
and needs no speed sensor.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.laws.extended_state_observer import ExtendedState, ObserverOutput, expected
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import exp, where


@dataclass(frozen=True)
class Eid(PositionLaw):
    """The law: state feedback, observer and filter."""

    natural_frequency: Annotated[
        NonNegative, Quantity("rad/s", "natural frequency of the state feedback", "by hand"), Tunable(0.2, 40)
    ] = 4.0
    damping: Annotated[
        NonNegative, Quantity("1", "damping ratio of the state feedback", "by hand"), Tunable(0.3, 3)
    ] = 1.0
    observer_bandwidth: Annotated[Positive, Quantity("rad/s", "poles of the observer", "by hand"), Tunable(2, 400)] = (
        60.0
    )
    filter_time: Annotated[
        Positive, Quantity("s", "time constant of the low-pass on the disturbance", "by hand"), Tunable(5e-3, 2)
    ] = 0.08

    kind: ClassVar = "eid"
    label: ClassVar = "EID"
    colour: ClassVar = "#999933"
    dashes: ClassVar = (0, (1, 1))

    def initial_state(self) -> ExtendedState:
        """Zero state."""
        return ExtendedState()

    def step(
        self, state: ExtendedState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[ExtendedState, ObserverOutput]:
        """One sample: correct the prediction, estimate the disturbance, command a force, predict the next sample."""
        T = context.sample_time
        pole = exp(-self.observer_bandwidth * T)
        innovation = where(state.primed, estimate.x - state.x, 0.0)
        x = where(state.primed, state.x, estimate.x) + (1 - pole**2) * innovation
        correction = (1 - pole) ** 2 / T * innovation
        v = where(state.primed, state.v, estimate.v) + correction
        d = state.d + (1 - exp(-T / self.filter_time)) * correction / T

        forces = nominal_forces(v, estimate.d, context.nominal)
        stiffness, damping = self.natural_frequency**2, 2 * self.damping * self.natural_frequency
        command = setpoint.a - stiffness * (x - setpoint.x) - damping * (v - setpoint.v)
        u = forces.mass * (command - d) + forces.resistance
        u_sat = context.limits.clipped(u)

        acceleration = (u_sat - forces.resistance) / forces.mass + d
        return expected(x, v, d, acceleration, T), ObserverOutput(u=u, u_sat=u_sat, d_hat=d)
