"""Parts as a user writes them: not registered, with vectors and matrices in their states and signals of their own."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import annotated_types as at
import casadi as ca
import numpy as np

from dualwinch.controllers.coordinations.differential_tension import DifferentialTension, TensionLoops
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import (
    Context,
    CoordinationOutput,
    Estimate,
    Estimator,
    Measurement,
    PositionLaw,
    PositionOutput,
)
from dualwinch.model.quantities.quantity import Elements, Mark, Quantity, Rule, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip


@dataclass(frozen=True)
class Belief:
    """Vector and matrix of a Kalman filter that finds its gain under way."""

    z: Annotated[
        Any,
        Elements((Quantity("m", "expected position"), Mark.POSITION), (Quantity("m/s", "expected speed"), Mark.SPEED)),
    ] = field(default_factory=lambda: np.zeros(2))
    P: Annotated[Any, Quantity("m^2", "their covariance, over that of the position")] = field(
        default_factory=lambda: np.eye(2)
    )


@dataclass(frozen=True)
class BeliefOutput(PositionOutput):
    gain: Annotated[Any, Quantity("1", "gain of the filter on position and speed")]
    surprise: Annotated[Scalar, Quantity("m", "what was not expected of the position")] = 0.0


@dataclass(frozen=True)
class StateFeedback(PositionLaw):
    """State feedback of the estimate of a filter of its own."""

    bandwidth: Annotated[
        float, at.Interval(gt=0, le=50), Quantity("rad/s", "poles of the feedback", "by hand"), Tunable(1, 10)
    ] = 4.0
    walk: Annotated[
        float, at.Gt(0), Quantity("1", "variance of the speed's walk", "by hand"), Tunable(1e-6, 1, standard=False)
    ] = 1e-2
    leak: Annotated[float, at.Ge(0), Quantity("1/s", "how fast a belief fades"), Mark.OFF_AT_ZERO] = 0.0
    advance: Annotated[float | None, at.Gt(0), Quantity("s", "looks ahead so far (default: not at all)")] = None

    kind: ClassVar = "state-feedback"
    rules: ClassVar = (
        Rule(("bandwidth",), lambda law: law.bandwidth > law.leak, lambda _, table: f"must be > {table}leak"),
    )

    def initial_state(self) -> Belief:
        return Belief()

    def step(
        self, state: Belief, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[Belief, BeliefOutput]:
        T, (P, z) = context.sample_time, (state.P, state.z)
        surprise = estimate.x - z[0]
        gain = P[:, :1] / (P[0, 0] + 1)
        x, v = z[0] + gain[0, 0] * surprise, z[1] + gain[1, 0] * surprise
        P = P - gain @ P[:1, :]
        ahead = 0.0 if self.advance is None else self.advance
        e1, e2 = x + ahead * v - setpoint.x - ahead * setpoint.v, v - setpoint.v
        forces = nominal_forces(v, estimate.d, context.nominal)
        w = self.bandwidth
        u = forces.mass * (setpoint.a - w**2 * e1 - 2 * w * e2) + forces.resistance
        u_sat = clip(u, -context.limits.force, context.limits.force)
        motion = ca.vertcat(ca.horzcat(1, T), ca.horzcat(0, 1))
        walk = self.walk * ca.vertcat(ca.horzcat(0, 0), ca.horzcat(0, T))
        a = (u_sat - forces.resistance) / forces.mass
        z = (1 - self.leak * T) * (motion @ ca.vertcat(x, v) + ca.vertcat(0, T * a))
        return Belief(z, motion @ P @ motion.T + walk), BeliefOutput(u, u_sat, gain, surprise)


@dataclass(frozen=True)
class Drift:
    offset: Annotated[Any, Quantity("m/s", "offset of the speed sensor, a vector of one")] = field(
        default_factory=lambda: np.zeros(1)
    )
    x: Annotated[Scalar, Quantity("m", "position of the last sample"), Mark.POSITION] = 0.0


@dataclass(frozen=True)
class DriftEstimate(Estimate):
    offset: Annotated[Scalar, Quantity("m/s", "offset of the speed sensor")] = 0.0


@dataclass(frozen=True)
class DriftFree(Estimator):
    """Takes an offset off the speed."""

    rate: Annotated[float, at.Ge(0), Quantity("1/s", "how fast the offset is learnt")] = 0.5

    kind: ClassVar = "drift-free"

    def initial_state(self) -> Drift:
        return Drift()

    def step(
        self,
        state: Drift,
        measurement: Measurement,
        setpoint: Setpoint,  # noqa: ARG002
        context: Context,
    ) -> tuple[Drift, DriftEstimate]:
        offset = state.offset[0]
        wrong = measurement.v - (measurement.x - state.x) / context.sample_time - offset
        following = ca.vertcat(offset + context.sample_time * self.rate * wrong)
        better = vars(measurement) | {"v": measurement.v - offset, "offset": offset}
        return Drift(following, measurement.x), DriftEstimate(**better)


@dataclass(frozen=True)
class WatchedOutput(CoordinationOutput):
    imbalance: Annotated[Scalar, Quantity("N", "sum of the tensions beyond the preload")] = 0.0


@dataclass(frozen=True)
class Watched(DifferentialTension):
    """A built-in part, changed."""

    share: Annotated[float, at.Ge(0), at.Le(1), Quantity("1", "share of the imbalance that counts")] = 1.0

    kind: ClassVar = "watched"

    def step(
        self, state: TensionLoops, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[TensionLoops, WatchedOutput]:
        following, output = super().step(state, force, estimate, setpoint, context)
        imbalance = self.share * (estimate.F1 + estimate.F2 - context.limits.preload)
        return following, WatchedOutput(**vars(output), imbalance=imbalance)
