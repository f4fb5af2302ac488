"""What an actuator is."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any

from dualwinch.model.quantities.part import Part
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Demand:
    """What is asked of a motor at a sample, and how it moves; positive in the direction that retrieves rope."""

    torque: Annotated[Scalar, Quantity("N m", "motor torque command")]
    angle: Annotated[Scalar, Quantity("rad", "angle of the motor's shaft")]
    speed: Annotated[Scalar, Quantity("rad/s", "speed of the motor's shaft")]


class Actuator(Part):
    """From torque command to motor torque: a frozen dataclass of the actuator's own numbers, the same for both winches.

    It stands behind the transport delay and before the plant, and belongs to the closed loop: no controller has it.
    """

    @abstractmethod
    def initial_state(self) -> Any:
        """State of one motor without torque: a dataclass of floats, vectors and matrices."""

    def holding_state(self, torque: Scalar) -> Any:  # noqa: ARG002
        """State of one motor that has been giving a torque in N m for long, over floats or CasADi symbols.

        A run begins with it, at the torque that holds the rope. Default: `initial_state`.
        """
        return self.initial_state()

    @abstractmethod
    def step(self, state: Any, demand: Demand, sample_time: Scalar) -> tuple[Any, Scalar]:
        """One sample of one motor, over floats or CasADi symbols.

        Args:
            state: as the last sample left it.
            demand: torque command, and the motor's angle and speed at the sample.
            sample_time: in s.

        Returns:
            The next state, and the torque in N m until the next sample, its mean where it is not constant.
        """
