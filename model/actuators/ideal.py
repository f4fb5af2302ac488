"""The ideal actuator: a motor gives the torque that is asked for, at once."""

from dataclasses import dataclass
from typing import ClassVar

from dualwinch.model.actuators.actuator import Actuator, Demand
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class NoState:
    """The state of what remembers nothing."""


@dataclass(frozen=True)
class Ideal(Actuator):
    """Gives what it is asked for; it adds nothing to the compiled code."""

    kind: ClassVar = "ideal"
    label: ClassVar = "ideal motor"

    def initial_state(self) -> NoState:
        """Nothing to remember."""
        return NoState()

    def step(self, state: NoState, demand: Demand, sample_time: Scalar) -> tuple[NoState, Scalar]:  # noqa: ARG002
        """The torque that is asked for."""
        return state, demand.torque


def is_ideal(actuator: Actuator) -> bool:
    """Whether an actuator is that of `Ideal`; one that is made of it may write another step."""
    return isinstance(actuator, Ideal) and type(actuator).step is Ideal.step
