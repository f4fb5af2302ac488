"""Actuators as a user writes them: not registered, one with a vector as its state, one that heeds the motor's speed."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import annotated_types as at
import casadi as ca
import numpy as np

from dualwinch.model.actuators import Actuator, Demand, NoState
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Torques:
    """Torque, and what it is filtered from."""

    tau: Annotated[Any, Quantity("N m", "torque behind one lag and behind two")] = field(
        default_factory=lambda: np.zeros(2)
    )


@dataclass(frozen=True)
class TwoLags(Actuator):
    """Two lags in a row."""

    lag: Annotated[float, at.Ge(1e-3), at.Le(1), Quantity("s", "time constant of both")] = 4e-3

    kind: ClassVar = "two-lags"
    label: ClassVar = "servo"

    def initial_state(self) -> Torques:
        return Torques()

    def holding_state(self, torque: Scalar) -> Torques:
        return Torques(ca.vertcat(torque, torque))

    def step(self, state: Torques, demand: Demand, sample_time: Scalar) -> tuple[Torques, Scalar]:
        share = sample_time / (self.lag + sample_time)
        first = state.tau[0] + share * (demand.torque - state.tau[0])
        second = state.tau[1] + share * (first - state.tau[1])
        return Torques(ca.vertcat(first, second)), second


@dataclass(frozen=True)
class Drooping(Actuator):
    """A motor whose torque droops with its speed; it remembers nothing."""

    droop: Annotated[float, at.Ge(0), Quantity("N m s", "torque lost a rad/s"), Mark.OFF_AT_ZERO] = 0.01

    kind: ClassVar = "drooping"

    def initial_state(self) -> NoState:
        return NoState()

    def step(self, state: NoState, demand: Demand, sample_time: Scalar) -> tuple[NoState, Scalar]:  # noqa: ARG002
        return state, demand.torque - self.droop * demand.speed
