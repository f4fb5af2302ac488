"""Equivalent-input-disturbance control: a state observer, a filtered estimate of the disturbance, a state feedback.

After She, Fang, Ohyama, Hashimoto and Wu, "Improving disturbance-rejection performance based on an
equivalent-input-disturbance approach" (IEEE Trans. Ind. Electron. 55 (2008) 380). Whatever acts on a plant, some
disturbance at its input has the same effect on the output. Their observer believes in a plant without disturbance::

    dx̂/dt = A x̂ + B u_f + L (y - C x̂)

and what its correction does, in terms of the input, is the estimate::

    d̂ = B⁺ L (y - C x̂) + u_f - u,      d̃ = F(s) d̂,      u = u_f - d̃

with a low-pass filter F of first order, which sets the bandwidth in which disturbances are rejected.

Here the output is the position and the input the acceleration of the nominal vehicle, less its resistance. The
observer is the discrete current one with both poles at ``exp(-observer_bandwidth * sample_time)``; of all left inverses
of B that is taken which looks at the speed alone, so that ``d̂ = d̃ + (its correction of the speed)/(sample time)``. In
continuous time observer and filter together have the poles of ``s³ + 2 w s² + w² s + w²/filter_time`` with w the
observer's bandwidth, stable for ``filter_time > 1/(2 w)``. Linear active disturbance rejection puts all three in one
place (`controllers.laws.adrc`); here the filter is apart. No speed sensor is needed, and nothing winds up, for the
observer is fed with the saturated command.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.context import Context
from dualwinch.controllers.laws.position_law import PositionLaw
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.signals import Estimate, PositionOutput
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, exp, where


@dataclass(frozen=True)
class EidState:
    """What the observer expects of the coming sample."""

    x: Annotated[Scalar, Quantity("m", "expected position"), Mark.POSITION] = 0.0
    v: Annotated[Scalar, Quantity("m/s", "expected speed"), Mark.SPEED] = 0.0
    d: Annotated[Scalar, Quantity("m/s^2", "filtered equivalent input disturbance")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0


@dataclass(frozen=True)
class EidOutput(PositionOutput):
    """What the law gives."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]


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

    def initial_state(self) -> EidState:
        """Nothing expected."""
        return EidState()

    def step(
        self, state: EidState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[EidState, EidOutput]:
        """One sample: correct what was expected, command, estimate the disturbance, expect the next sample."""
        T = context.sample_time
        pole = exp(-self.observer_bandwidth * T)
        surprise = where(state.primed, estimate.x - state.x, 0.0)
        x = where(state.primed, state.x, estimate.x) + (1 - pole**2) * surprise
        correction = (1 - pole) ** 2 / T * surprise
        v = where(state.primed, state.v, estimate.v) + correction
        d = state.d + (1 - exp(-T / self.filter_time)) * correction / T

        forces = nominal_forces(v, estimate.d, context.nominal)
        stiffness, damping = self.natural_frequency**2, 2 * self.damping * self.natural_frequency
        wanted = setpoint.a - stiffness * (x - setpoint.x) - damping * (v - setpoint.v)
        u = forces.mass * (wanted - d) + forces.resistance
        limit = context.limits.force
        u_sat = clip(u, -limit, limit)

        acceleration = (u_sat - forces.resistance) / forces.mass + d
        following = EidState(x=x + T * v + T**2 / 2 * acceleration, v=v + T * acceleration, d=d, primed=1.0)
        return following, EidOutput(u=u, u_sat=u_sat, d_hat=d)
