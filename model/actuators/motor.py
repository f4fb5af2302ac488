"""A motor with its drive: the torque follows the command with a lag, and no faster than the drive allows.

While the command u is held, ``d torque/dt = clip((u − torque)/time_constant, −rate_limit, rate_limit)``. The lag is
solved exactly from sample to sample, through the end of a rate-limited stretch too; the plant gets the torque's mean
over the sample, so that the momentum is right.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.model.actuators.actuator import Actuator, Demand
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar, absolute, clip, tanh, where


@dataclass(frozen=True)
class MotorState:
    """State of one motor."""

    torque: Annotated[Scalar, Quantity("N m", "motor torque")]


@dataclass(frozen=True)
class Motor(Actuator):
    """First-order lag, and a limit on the torque's rate."""

    time_constant: Annotated[
        float, at.Gt(0), Quantity("s", "time constant of the torque loop of motor and drive", "assumption")
    ] = 5e-3
    rate_limit: Annotated[
        float | None, at.Gt(0), Quantity("N m/s", "fastest change of the torque (default: no limit)", "assumption")
    ] = None

    kind: ClassVar = "motor"
    label: ClassVar = "motor with lag"

    def initial_state(self) -> MotorState:
        """No torque."""
        return MotorState(0.0)

    def holding_state(self, torque: Scalar) -> MotorState:
        """The torque itself."""
        return MotorState(torque)

    def step(self, state: MotorState, demand: Demand, sample_time: Scalar) -> tuple[MotorState, Scalar]:
        """Torque at the next sample, and its mean until then."""
        missing = demand.torque - state.torque
        if self.rate_limit is None:
            left, passed = _decay(sample_time / self.time_constant)
            mean_left = passed * self.time_constant / sample_time
            return MotorState(demand.torque - left * missing), demand.torque - mean_left * missing
        size, sign = absolute(missing), where(missing < 0, -1.0, 1.0)
        # first at the limit, until so little is missing that the lag alone is slower
        limited = clip(size / self.rate_limit - self.time_constant, 0.0, sample_time)
        then = size - self.rate_limit * limited
        left, passed = _decay((sample_time - limited) / self.time_constant)
        missed = limited * (size + then) / 2 + then * self.time_constant * passed  # integral of what is missing
        return MotorState(demand.torque - sign * left * then), demand.torque - sign * missed / sample_time


def _decay(time: Scalar) -> tuple[Scalar, Scalar]:
    """exp(−time) and 1 − exp(−time), in which nothing is lost where the time is short."""
    half = tanh(time / 2)
    return (1 - half) / (1 + half), 2 * half / (1 + half)
