"""Force–position decoupled coordination: the winch in front moves the vehicle, the one behind holds the tension.

The paper describes it as the alternative it argues against (Section 1.1): the motor on the side to which the vehicle is
pulled controls the motion, the motor behind it controls the tension, and every reversal exchanges their roles.

The assignment of roles is ours: the rope behind is commanded half the preload with a closed tension loop; the rope in
front is commanded that plus the force, as a torque, with an open tension loop. Force beyond the limit of the rope in
front is taken from the rope behind. The commands are continuous in the force; in a band of forces around zero both
loops are partly closed. The integral of the winch in front is held.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

from dualwinch.controllers.coordinations.differential_tension import TensionLoops, follow_tensions
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.limits import within_limits
from dualwinch.controllers.parts import Context, Coordination, CoordinationOutput, Estimate
from dualwinch.model.quantities.quantity import Positive, Quantity, Tied, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, maximum


@dataclass(frozen=True)
class ForcePosition(Coordination):
    """The force decides which winch is in front."""

    band: Annotated[
        Positive,
        Quantity("N", "largest force at which both winches share the tension control", "by hand"),
        Tunable(1, 2000, of="controller.coordination.tension_max"),
    ] = 100.0
    winch_1: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)
    winch_2: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)

    kind: ClassVar = "force-position"
    label: ClassVar = "force–position"

    def initial_state(self) -> TensionLoops:
        """Empty integrals."""
        return TensionLoops.of(self.winch_1, self.winch_2)

    def step(
        self, state: TensionLoops, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[TensionLoops, CoordinationOutput]:
        """One sample of both winches."""
        half_preload = context.limits.preload / 2
        commands = within_limits(
            half_preload + maximum(force, 0.0), half_preload + maximum(-force, 0.0), context.limits
        )
        behind_2 = clip(0.5 + force / (2 * self.band), 0.0, 1.0)
        shares = 1 - behind_2, behind_2
        regulated = replace(
            estimate,
            F1=commands[0] - shares[0] * (commands[0] - estimate.F1),
            F2=commands[1] - shares[1] * (commands[1] - estimate.F2),
        )
        return follow_tensions(state, commands, regulated, (self.winch_1, self.winch_2), setpoint, context)
