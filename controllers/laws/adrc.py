"""Linear active disturbance rejection: an extended state observer and a state feedback, each with one bandwidth.

After Gao, "Scaling and bandwidth-parameterization based controller tuning" (American Control Conference 2003, 4989):
all poles of the observer lie at ``-observer_bandwidth``, those of the feedback at ``-control_bandwidth``. The observer
is the discrete current one of Miklosovic, Radke and Gao (American Control Conference 2006), whose poles lie at
``exp(-observer_bandwidth * sample_time)`` exactly; it is stable for every bandwidth.

It knows position, speed and the disturbance acceleration, is fed with the position and with the acceleration that the
last saturated command would give the nominal vehicle, and so neither winds up nor needs a speed sensor: friction and
drag are compensated at the estimated speed.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.controllers.context import Context
from dualwinch.controllers.laws.nominal_forces import nominal_forces
from dualwinch.controllers.laws.position_law import PositionLaw
from dualwinch.controllers.signals import Estimate, PositionOutput
from dualwinch.model.quantities.quantity import Mark, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, exp, where


@dataclass(frozen=True)
class AdrcState:
    """What the observer expects of the coming sample."""

    x: Annotated[Scalar, Quantity("m", "expected position"), Mark.POSITION] = 0.0
    v: Annotated[Scalar, Quantity("m/s", "expected speed"), Mark.SPEED] = 0.0
    d: Annotated[Scalar, Quantity("m/s^2", "expected disturbance acceleration")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0


@dataclass(frozen=True)
class AdrcOutput(PositionOutput):
    """What the law gives."""

    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]


@dataclass(frozen=True)
class Adrc(PositionLaw):
    """The law and its two bandwidths."""

    control_bandwidth: Annotated[
        float, at.Ge(0), Quantity("rad/s", "poles of the feedback", "by hand"), Tunable(0.2, 40)
    ] = 4.0
    observer_bandwidth: Annotated[
        float, at.Gt(0), Quantity("rad/s", "poles of the observer", "by hand"), Tunable(1, 200)
    ] = 20.0

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
        pole = exp(-self.observer_bandwidth * T)
        surprise = where(state.primed, estimate.x - state.x, 0.0)
        x = where(state.primed, state.x, estimate.x) + (1 - pole**3) * surprise
        v = where(state.primed, state.v, estimate.v) + 1.5 * (1 - pole) ** 2 * (1 + pole) / T * surprise
        d = state.d + (1 - pole) ** 3 / T**2 * surprise

        forces = nominal_forces(v, estimate.d, context.nominal)
        proportional, derivative = self.control_bandwidth**2, 2 * self.control_bandwidth
        wanted = setpoint.a - proportional * (x - setpoint.x) - derivative * (v - setpoint.v)
        u = forces.mass * (wanted - d) + forces.resistance
        limit = context.limits.force
        u_sat = clip(u, -limit, limit)

        acceleration = (u_sat - forces.resistance) / forces.mass + d
        following = AdrcState(x=x + T * v + T**2 / 2 * acceleration, v=v + T * acceleration, d=d, primed=1.0)
        return following, AdrcOutput(u=u, u_sat=u_sat, d_hat=d)
