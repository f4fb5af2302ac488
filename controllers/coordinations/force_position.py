"""Force–position decoupled coordination: the winch in front moves the vehicle, the one behind holds the tension.

The paper describes it as what it argues against (Section 1.1): the motor on the side the vehicle is pulled to governs
the motion, the motor behind it regulates the tension, and every reversal makes them change roles.

Ours is how the roles are made: the rope behind is commanded half the preload and its tension loop is closed; the
rope in front is commanded that plus the force, as a torque, with its tension loop open. What the rope in front cannot
give, the one behind gives up. The commands are continuous in the force; the loops are handed over along a band of
forces around zero, in which both are partly closed. While a winch is in front its integral is held.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import annotated_types as at

from dualwinch.controllers.coordinations.differential_tension import TensionLoops, follow_tensions
from dualwinch.controllers.limits import CoordinationOutput, within_limits
from dualwinch.controllers.signals import Measurement
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, maximum

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class ForcePositionGains:
    """How the roles change."""

    band: Annotated[
        float,
        at.Gt(0),
        Quantity("N", "largest force at which both winches still share the tension control", "by hand"),
        Tunable(1, 2000),
    ] = 100.0


def force_position_step(
    state: TensionLoops,
    u_sat: Scalar,
    measurement: Measurement,
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[TensionLoops, CoordinationOutput]:
    """One sample: `u_sat` in N decides which winch is in front."""
    limits = controller.coordination
    rest = limits.preload / 2
    commands = within_limits(rest + maximum(u_sat, 0.0), rest + maximum(-u_sat, 0.0), limits)
    behind_2 = clip(0.5 + u_sat / (2 * controller.force_position.band), 0.0, 1.0)
    shares = 1 - behind_2, behind_2
    regulated = (
        commands[0] - shares[0] * (commands[0] - measurement.F1),
        commands[1] - shares[1] * (commands[1] - measurement.F2),
    )
    return follow_tensions(state, commands, regulated, setpoint, controller, nominal, sample_time)
