"""Differential-tension coordination: one force command becomes two tension commands (paper Sections 3.2, 3.3, E11)."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dualwinch.controllers.coordinations.winch_pid import WinchState, winch_step
from dualwinch.controllers.limits import Coordination, CoordinationOutput, within_limits
from dualwinch.controllers.signals import Measurement
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, either

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class TensionLoops:
    """State of the two winches' tension controllers."""

    winch_1: WinchState = field(default_factory=WinchState)
    winch_2: WinchState = field(default_factory=WinchState)


def tension_commands(u_sat: Scalar, coordination: Coordination) -> tuple[Scalar, Scalar]:
    """Commands F1_cmd and F2_cmd in N: half the preload plus and minus half the force (paper Section 3.2).

    Args:
        u_sat: net force in N, within ± `force_limit`.
        coordination: preload and limits.
    """
    return within_limits((coordination.preload + u_sat) / 2, (coordination.preload - u_sat) / 2, coordination)


def follow_tensions(
    state: TensionLoops,
    commands: tuple[Scalar, Scalar],
    tensions: tuple[Scalar, Scalar],
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[TensionLoops, CoordinationOutput]:
    """One sample of both tension controllers (paper Section 3.3), from tension commands and tensions in N."""
    winch_1, torque_1 = winch_step(
        state.winch_1,
        commands[0],
        tensions[0],
        setpoint.a / nominal.winch_1.drum_radius,
        nominal.winch_1,
        controller.winch_1,
        controller.coordination,
        sample_time,
    )
    winch_2, torque_2 = winch_step(
        state.winch_2,
        commands[1],
        tensions[1],
        -setpoint.a / nominal.winch_2.drum_radius,
        nominal.winch_2,
        controller.winch_2,
        controller.coordination,
        sample_time,
    )
    saturated = either(torque_1.saturated, torque_2.saturated)
    return TensionLoops(winch_1, winch_2), CoordinationOutput(*commands, torque_1.torque, torque_2.torque, saturated)


def differential_tension_step(
    state: TensionLoops,
    u_sat: Scalar,
    measurement: Measurement,
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[TensionLoops, CoordinationOutput]:
    """One sample: both winches follow tension commands, whose sum is the preload and whose difference the force."""
    commands = tension_commands(u_sat, controller.coordination)
    measured = measurement.F1, measurement.F2
    return follow_tensions(state, commands, measured, setpoint, controller, nominal, sample_time)
