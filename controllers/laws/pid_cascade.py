"""Baseline: a position loop around a speed loop (the paper gives only four of its gains, A12)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.model.quantities.quantity import NonNegative, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, both, either, where
from dualwinch.model.vehicle import inertia


@dataclass(frozen=True)
class PidCascadeState:
    """State of the two loops."""

    I1: Annotated[Scalar, Quantity("m s", "integral of the position error")] = 0.0
    I2: Annotated[Scalar, Quantity("m", "integral of the speed error")] = 0.0
    ev_previous: Annotated[Scalar, Quantity("m/s", "speed error of the last sample")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0


@dataclass(frozen=True)
class PidCascade(PositionLaw):
    """The two loops and their gains."""

    kp1: Annotated[NonNegative, Quantity("1/s", "position loop, proportional", "paper 4.1"), Tunable(0.1, 100)] = 10.0
    ki1: Annotated[NonNegative, Quantity("1/s^2", "position loop, integral", "paper 4.1"), Tunable(1e-3, 100)] = 0.1
    kd1: Annotated[
        NonNegative, Quantity("1", "position loop, derivative", "A12"), Tunable(0, 2, log=False, standard=False)
    ] = 0.0
    kp2: Annotated[NonNegative, Quantity("1/s", "speed loop, proportional", "paper 4.1"), Tunable(0.1, 100)] = 2.0
    ki2: Annotated[NonNegative, Quantity("1/s^2", "speed loop, integral", "paper 4.1"), Tunable(1e-3, 100)] = 0.05
    kd2: Annotated[
        NonNegative, Quantity("1", "speed loop, derivative", "A12"), Tunable(0, 0.5, log=False, standard=False)
    ] = 0.0

    kind: ClassVar = "pid-cascade"
    label: ClassVar = "PID cascade"
    colour: ClassVar = "#009E73"
    dashes: ClassVar = (0, (5, 1.5, 1, 1.5))

    def initial_state(self) -> PidCascadeState:
        """Empty integrals."""
        return PidCascadeState()

    def step(
        self, state: PidCascadeState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[PidCascadeState, PositionOutput]:
        """One sample; both integrals are held while they would increase the force further beyond its limit."""
        mass, limit, sample_time = inertia(context.nominal.vehicle), context.limits.force, context.sample_time
        e1, e2 = estimate.x - setpoint.x, estimate.v - setpoint.v

        def speed_error(I1: Scalar) -> Scalar:
            return -self.kp1 * e1 - self.ki1 * I1 - self.kd1 * e2 - estimate.v

        def force(ev: Scalar, I2: Scalar) -> Scalar:
            slope = state.primed * (ev - state.ev_previous) / sample_time
            return mass * (self.kp2 * ev + self.ki2 * I2 + self.kd2 * slope)

        I1 = state.I1 + sample_time * e1
        ev = speed_error(I1)
        I2 = state.I2 + sample_time * ev
        u = force(ev, I2)
        winding_up = either(both(u > limit, ev > 0), both(u < -limit, ev < 0))
        held_ev = speed_error(state.I1)
        u = where(winding_up, force(held_ev, state.I2), u)
        next_state = PidCascadeState(
            I1=where(winding_up, state.I1, I1),
            I2=where(winding_up, state.I2, I2),
            ev_previous=where(winding_up, held_ev, ev),
            primed=1.0,
        )
        return next_state, PositionOutput(u=u, u_sat=context.limits.clipped(u))
