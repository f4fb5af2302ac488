"""LQI: linear-quadratic regulator with integral action, parameterised by its weights.

After Young and Willems, "An approach to the linear multivariable servomechanism problem" (Int. J. Control 15 (1972)
961): the state of a regulator is extended by the integral of the tracking error. With a Kalman filter as the estimator
(`controllers.estimators`) it is LQG with integral action (Athans, IEEE Trans. Autom. Control 16 (1971) 529); the
disturbance estimated by the filter is compensated with the nominal resistance, the rest by the integral.

The remaining plant is a mass under the commanded acceleration w, constant over a sample. The law minimises

    sum over the samples of  (I/integral)² + (e1/position)² + (e2/speed)² + (w/acceleration)²

with I the integral of e1: each weight is an acceptable error or correction (Bryson's rule; Bryson and Ho, *Applied
Optimal Control*, 1975). The feedback gain solves the discrete Riccati equation of these weights and the sample time; it
depends on parameters alone and is computed once per run.

Our addition: the integral is held where it would increase the force further beyond its limit.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.model.matrix import Matrix, diagonal, riccati, times, transpose
from dualwinch.model.quantities.quantity import Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, both, either, where

DOUBLINGS = 24
"""Doubling steps: the gain is that of a horizon of 2^24 samples, far longer than the slowest integral."""


@dataclass(frozen=True)
class LqiState:
    """State of the law."""

    integral: Annotated[Scalar, Quantity("m s", "integral of the position error")] = 0.0


@dataclass(frozen=True)
class Lqi(PositionLaw):
    """The law and its weights; only their ratios matter."""

    position: Annotated[Positive, Quantity("m", "position error of weight 1", "by hand"), Tunable(1e-5, 1e-2)] = 2e-3
    speed: Annotated[Positive, Quantity("m/s", "speed error of weight 1", "by hand"), Tunable(1e-4, 1)] = 2e-2
    integral: Annotated[
        Positive, Quantity("m s", "integral of the position error of weight 1", "by hand"), Tunable(1e-5, 1e-2)
    ] = 1e-3
    acceleration: Annotated[
        Positive, Quantity("m/s^2", "correcting acceleration of weight 1", "by hand"), Tunable(1e-3, 10, standard=False)
    ] = 0.2

    kind: ClassVar = "lqi"
    label: ClassVar = "LQI"
    colour: ClassVar = "#332288"
    dashes: ClassVar = (0, (8, 2))

    def initial_state(self) -> LqiState:
        """An empty integral."""
        return LqiState()

    def gain(self, sample_time: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Gains on the integral in 1/s³, on the position error in 1/s² and on the speed error in 1/s.

        Computed in units of the sample time in s, in which the matrices of the motion contain only 1 and 1/2.
        """
        T = sample_time
        motion: Matrix = ((1.0, 1.0, 0.0), (0.0, 1.0, 1.0), (0.0, 0.0, 1.0))
        push: Matrix = ((0.0,), (0.5,), (1.0,))
        errors = (self.integral / T, self.position, self.speed * T)
        weights = diagonal(*((self.acceleration * T**2 / error) ** 2 for error in errors))
        cost = times(transpose(push), riccati(motion, times(push, transpose(push)), weights, DOUBLINGS))
        (curvature,), (slopes,) = times(cost, push)[0], times(cost, motion)
        on_integral, on_position, on_speed = (slope / (1 + curvature) for slope in slopes)
        return on_integral / T**3, on_position / T**2, on_speed / T

    def step(
        self, state: LqiState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[LqiState, PositionOutput]:
        """One sample: feedback of the errors and of the integral up to the last sample."""
        on_integral, on_position, on_speed = self.gain(context.sample_time)
        forces = nominal_forces(estimate.v, estimate.d, context.nominal)
        e1, e2, limit = estimate.x - setpoint.x, estimate.v - setpoint.v, context.limits.force
        correction = -(on_integral * state.integral + on_position * e1 + on_speed * e2)
        u = forces.mass * (setpoint.a + correction) + forces.resistance
        winding_up = either(both(u > limit, e1 < 0), both(u < -limit, e1 > 0))
        following = LqiState(where(winding_up, state.integral, state.integral + context.sample_time * e1))
        return following, PositionOutput(u=u, u_sat=context.limits.clipped(u))
