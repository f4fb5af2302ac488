"""Actuators: from the torque command of a motor to its torque.

The torque of the built-in `Motor` follows the command u with a first-order lag and a rate limit. The command is limited
to what the drive can give: a constant torque up to the base speed and a constant power above it, where its voltage ends
(field weakening; Leonhard, Control of Electrical Drives, 3rd ed., 2001). While u is held,
``d torque/dt = clip((u − torque)/time_constant, −rate_limit, rate_limit)``. The lag is solved exactly from sample to
sample, including the end of rate limiting; the plant gets the mean torque of the sample, which conserves momentum.

A motor's temperature above its surroundings, over that at the continuous torque, follows the losses of its windings
(thermal model of first order; IEC 60255-149)::

    thermal_time d heat/dt = (torque/continuous_torque)² − heat

From heat 1 on the drive gives the continuous torque only, until the motor has cooled.
"""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import annotated_types as at

from dualwinch.model.plant import Plant, PlantState, Torques
from dualwinch.model.quantities.part import NoState, Part, Registry
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity
from dualwinch.model.quantities.steps import stepped_to_number
from dualwinch.model.scalar import Scalar, absolute, clip, maximum, present, tanh, where


@dataclass(frozen=True)
class Demand:
    """Torque command and motion of a motor at a sample; positive in the direction that retrieves rope."""

    torque: Annotated[Scalar, Quantity("N m", "motor torque command")]
    angle: Annotated[Scalar, Quantity("rad", "angle of the motor's shaft")]
    speed: Annotated[Scalar, Quantity("rad/s", "speed of the motor's shaft")]


class Actuator(Part):
    """From torque command to motor torque: a frozen dataclass of the actuator's parameters, the same for both winches.

    It acts after the transport delay and before the plant. It is part of the closed loop, not of a controller.
    """

    @abstractmethod
    def initial_state(self) -> Any:
        """State of one motor without torque: a dataclass of floats, vectors and matrices."""

    def holding_state(self, torque: Scalar) -> Any:  # noqa: ARG002
        """Steady state of one motor at a constant torque in N m, over floats or CasADi symbols.

        A run begins with it, at the torque that holds the rope. Default: `initial_state`.
        """
        return self.initial_state()

    def unlimited(self) -> "Actuator":
        """The actuator without limits on its torque, whose loop `analysis` linearises. Default: itself."""
        return self

    @abstractmethod
    def step(self, state: Any, demand: Demand, sample_time: Scalar) -> tuple[Any, Scalar]:
        """One sample of one motor, over floats or CasADi symbols.

        Args:
            state: the state after the last sample.
            demand: torque command, and the motor's angle and speed at the sample.
            sample_time: in s.

        Returns:
            The next state, and the mean torque in N m until the next sample.
        """


@dataclass(frozen=True)
class Ideal(Actuator):
    """The torque equals the command; adds nothing to the compiled code."""

    kind: ClassVar = "ideal"
    label: ClassVar = "ideal motor"

    def initial_state(self) -> NoState:
        """No state."""
        return NoState()

    def step(self, state: NoState, demand: Demand, sample_time: Scalar) -> tuple[NoState, Scalar]:  # noqa: ARG002
        """The command itself."""
        return state, demand.torque


def is_ideal(actuator: Actuator) -> bool:
    """Whether an actuator has the step of `Ideal`, which subclasses may override."""
    return isinstance(actuator, Ideal) and type(actuator).step is Ideal.step


@dataclass(frozen=True)
class MotorState:
    """State of one motor."""

    torque: Annotated[Scalar, Quantity("N m", "motor torque")]


@dataclass(frozen=True)
class WarmMotorState(MotorState):
    """State of one motor that warms."""

    heat: Annotated[Scalar, Quantity("1", "temperature above the surroundings over that at the continuous torque")]


@dataclass(frozen=True)
class Motor(Actuator):
    """First-order lag, and limits on the torque and its rate."""

    time_constant: Annotated[
        Positive, Quantity("s", "time constant of the torque loop of motor and drive", "assumption")
    ] = 5e-3
    rate_limit: Annotated[
        float | None, at.Gt(0), Quantity("N m/s", "fastest change of the torque (default: no limit)", "assumption")
    ] = None

    torque_limit: Annotated[
        NonNegative,
        Quantity("N m", "largest torque, up to the base speed; 0: no limit", "data sheet, assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    base_speed: Annotated[
        NonNegative,
        Quantity("rad/s", "shaft speed above which the power is constant; 0: the torque is", "data sheet, assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    continuous_torque: Annotated[
        NonNegative,
        Quantity(
            "N m", "torque that the motor can give for ever, to which a hot one is limited; 0: no heat", "data sheet"
        ),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    thermal_time: Annotated[
        Positive, Quantity("s", "thermal time constant of the motor", "data sheet, assumption"), Mark.SHAPE_PARAMETER
    ] = 60.0

    kind: ClassVar = "motor"
    label: ClassVar = "motor with lag"

    def initial_state(self) -> MotorState:
        """No torque."""
        return self.holding_state(0.0)

    def holding_state(self, torque: Scalar) -> MotorState:
        """The torque itself, and its heat."""
        if not present(self.continuous_torque):
            return MotorState(torque)
        return WarmMotorState(torque, (torque / self.continuous_torque) ** 2)

    def unlimited(self) -> "Motor":
        """The lag alone: a motor that is always cold and below its base speed."""
        return replace(self, rate_limit=None, torque_limit=0.0, continuous_torque=0.0)

    def step(self, state: MotorState, demand: Demand, sample_time: Scalar) -> tuple[MotorState, Scalar]:
        """Torque at the next sample, and its mean until then."""
        command = self.available(demand)
        if not isinstance(state, WarmMotorState):
            torque, mean = self._following(state.torque, command, sample_time)
            return MotorState(torque), mean
        bearable = clip(command, -self.continuous_torque, self.continuous_torque)
        torque, mean = self._following(state.torque, where(state.heat < 1, command, bearable), sample_time)
        _, warmed = _decay(sample_time / self.thermal_time)
        heat = state.heat + warmed * ((mean / self.continuous_torque) ** 2 - state.heat)
        return WarmMotorState(torque, heat), mean

    def _following(self, torque: Scalar, command: Scalar, sample_time: Scalar) -> tuple[Scalar, Scalar]:
        """Torque in N m at the next sample, and its mean until then, that follows a command."""
        shortfall = command - torque
        if self.rate_limit is None:
            decay, passed = _decay(sample_time / self.time_constant)
            mean_left = passed * self.time_constant / sample_time
            return command - decay * shortfall, command - mean_left * shortfall
        size, sign = absolute(shortfall), where(shortfall < 0, -1.0, 1.0)
        # at the rate limit first, until the lag alone is slower
        limited = clip(size / self.rate_limit - self.time_constant, 0.0, sample_time)
        then = size - self.rate_limit * limited
        decay, passed = _decay((sample_time - limited) / self.time_constant)
        missed = limited * (size + then) / 2 + then * self.time_constant * passed  # integral of what is missing
        return command - sign * decay * then, command - sign * missed / sample_time

    def available(self, demand: Demand) -> Scalar:
        """The demanded torque in N m, limited to what the drive can give at the speed of the shaft.

        Example:
            >>> motor = Motor(torque_limit=133.0, base_speed=60.0)
            >>> [motor.available(Demand(torque=150.0, angle=0.0, speed=speed)) for speed in (50.0, 80.0)]
            [133.0, 99.75]
        """
        if not present(self.torque_limit):
            return demand.torque
        limit = self.torque_limit
        if present(self.base_speed):
            limit = limit * self.base_speed / maximum(absolute(demand.speed), self.base_speed)
        return clip(demand.torque, -limit, limit)


def _decay(time: Scalar) -> tuple[Scalar, Scalar]:
    """exp(−time) and 1 − exp(−time), without cancellation for short times."""
    half = tanh(time / 2)
    return (1 - half) / (1 + half), 2 * half / (1 + half)


def drive(
    states: tuple[Any, Any], asked: Torques, motion: PlantState, plant: Plant, actuator: Actuator, sample_time: Scalar
) -> tuple[tuple[Any, Any], Torques]:
    """Next states of both actuators, and the motor torques until then, from the commands and the motion of the shafts.

    Raises:
        ConfigurationError: the actuator's step is invalid (`model.quantities.steps`).
    """
    steps = []
    commands = asked.tau_1, asked.tau_2
    for side, drum, state, torque in zip(plant.sides, motion.shafts, states, commands, strict=True):
        demand = Demand(torque, *(side.winch.gear_ratio * value for value in drum))
        steps.append(stepped_to_number(actuator, state, "torque", demand, sample_time))
    (state_1, torque_1), (state_2, torque_2) = steps
    return (state_1, state_2), Torques(torque_1, torque_2)


ACTUATORS: Registry[Actuator] = Registry("actuator", Ideal, Motor)
"""Every actuator by its kind."""
