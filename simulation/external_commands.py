"""External commands in place of the controller's: a force, or the torques of both motors."""

import sys
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from dualwinch.controllers.parts import Context, Coordination, CoordinationOutput, Estimate, PositionLaw, PositionOutput
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, either
from dualwinch.model.winch import Winch
from dualwinch.simulation.experiment import Experiment

CommandName: TypeAlias = Literal["torques", "force"]
COMMANDS: tuple[CommandName, ...] = get_args(CommandName)

ROUNDING = sys.float_info.epsilon**0.5
"""Relative distance from its limit at which a torque still counts as saturated, as it may have been rounded."""


@dataclass(frozen=True)
class Sensed(PositionOutput):
    """Output of a law that also shows its inputs: the sensor values as passed on by the estimator."""

    e_sensed: Annotated[Scalar, Quantity("m", "tracking error as the controller has it")]
    x_sensed: Annotated[Scalar, Quantity("m", "position as the controller has it")]
    v_sensed: Annotated[Scalar, Quantity("m/s", "speed as the controller has it")]
    F1_sensed: Annotated[Scalar, Quantity("N", "tension of rope 1 as the controller has it")]
    F2_sensed: Annotated[Scalar, Quantity("N", "tension of rope 2 as the controller has it")]
    omega_1_sensed: Annotated[Scalar, Quantity("rad/s", "speed of drum 1 as the controller has it")]
    omega_2_sensed: Annotated[Scalar, Quantity("rad/s", "speed of drum 2 as the controller has it")]
    theta_1_sensed: Annotated[Scalar, Quantity("rad", "angle of drum 1 as the controller has it")]
    theta_2_sensed: Annotated[Scalar, Quantity("rad", "angle of drum 2 as the controller has it")]
    d_sensed: Annotated[Scalar, Quantity("m/s^2", "disturbance acceleration that the estimator knows")]


def sensed(u: Scalar, u_sat: Scalar, estimate: Estimate, setpoint: Setpoint) -> Sensed:
    """The output for a force in N before and after saturation, with the values known to the controller."""
    names = ("x", "v", "F1", "F2", "omega_1", "omega_2", "theta_1", "theta_2", "d")
    estimates = {f"{name}_sensed": getattr(estimate, name) for name in names}
    return Sensed(u=u, u_sat=u_sat, e_sensed=estimate.x - setpoint.x, **estimates)


@dataclass(frozen=True)
class Force:
    """An external force command."""

    u: Annotated[Scalar, Quantity("N", "force command from outside")] = 0.0


@dataclass(frozen=True)
class GivenForce(PositionLaw):
    """A placeholder law: the force is commanded externally and limited like that of any law."""

    kind: ClassVar = "given-force"
    label: ClassVar = "given force"

    def initial_state(self) -> Force:
        """No force."""
        return Force()

    def step(self, state: Force, estimate: Estimate, setpoint: Setpoint, context: Context) -> tuple[Force, Sensed]:
        """One sample."""
        limit = context.limits.force
        return state, sensed(state.u, clip(state.u, -limit, limit), estimate, setpoint)


@dataclass(frozen=True)
class MotorTorques:
    """External torque commands."""

    tau_1: Annotated[Scalar, Quantity("N m", "motor torque of winch 1 from outside")] = 0.0
    tau_2: Annotated[Scalar, Quantity("N m", "motor torque of winch 2 from outside")] = 0.0


def pulls(torques: MotorTorques, nominal: Plant) -> tuple[Scalar, Scalar]:
    """Tensions in N that motor torques hold at rest."""

    def pull(torque: Scalar, winch: Winch) -> Scalar:
        return winch.gear_ratio / winch.drum_radius * torque

    return pull(torques.tau_1, nominal.winch_1), pull(torques.tau_2, nominal.winch_2)


@dataclass(frozen=True)
class ForceOfTorques(PositionLaw):
    """A placeholder law: the net force that the external torques hold at rest."""

    kind: ClassVar = "given-torques"
    label: ClassVar = "given torques"

    def initial_state(self) -> MotorTorques:
        """No torques."""
        return MotorTorques()

    def step(
        self,
        state: MotorTorques,
        estimate: Estimate,
        setpoint: Setpoint,
        context: Context,
    ) -> tuple[MotorTorques, Sensed]:
        """One sample."""
        F1, F2 = pulls(state, context.nominal)
        return state, sensed(F1 - F2, F1 - F2, estimate, setpoint)


@dataclass(frozen=True)
class GivenTorques(Coordination):
    """A placeholder coordination: passes on the external torques."""

    kind: ClassVar = "given-torques"
    label: ClassVar = "given torques"

    def initial_state(self) -> MotorTorques:
        """No torques."""
        return MotorTorques()

    def step(
        self,
        state: MotorTorques,
        force: Scalar,  # noqa: ARG002
        estimate: Estimate,  # noqa: ARG002
        setpoint: Setpoint,  # noqa: ARG002
        context: Context,
    ) -> tuple[MotorTorques, CoordinationOutput]:
        """One sample; a torque counts as saturated at or beyond the limits of the other coordinations."""
        commands, limits = pulls(state, context.nominal), context.limits
        lower, upper = limits.tension_min * (1 + ROUNDING), limits.tension_max * (1 - ROUNDING)
        at_limit = either(*(either(pull <= lower, pull >= upper) for pull in commands))
        return state, CoordinationOutput(*commands, state.tau_1, state.tau_2, at_limit)


NOUNS: dict[CommandName, str] = {"torques": "motor torques tau_1, tau_2 in N m", "force": "a force in N"}
"""Description of each kind of command."""

COMMANDED_STATES: dict[CommandName, tuple[tuple[str, ...], ...]] = {
    "torques": tuple((f"controller.law.{name}", f"controller.coordination.{name}") for name in ("tau_1", "tau_2")),
    "force": (("controller.law.u",),),
}
"""For each number of a command, the states into which it is written."""


def under_command(experiment: Experiment, command: CommandName) -> Experiment:
    """An experiment whose controller passes on external commands and keeps its estimator.

    Torques replace law and coordination, a force the law.
    """
    controller = experiment.controller
    if command == "force":
        return replace(experiment, controller=replace(controller, law=GivenForce()))
    return replace(experiment, controller=replace(controller, law=ForceOfTorques(), coordination=GivenTorques()))
