"""Proportional tension: differential tension with the fast force shared in proportion to the tensions.

The stiffness of a rope that sags between rollers is reduced by Ernst's factor, which depends on the cube of its
tension. The rope in front, at some thousand newtons, responds at once; the rope behind, near its lower limit, excites
its spans, so that a fast force comes late or makes it slack. The paper's coordination (Section 3.2) commands the same
change of both. Here this holds for the slow force only; the part faster than `slow_time` is shared in proportion to the
two slow commands, so that both change by the same percentage. The net force equals the command at all frequencies, and
the sum of the slow commands is the preload. At equal tensions both coordinations are identical.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from dualwinch.controllers.coordinations.differential_tension import TensionLoops, follow_tensions, tension_commands
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.limits import within_limits
from dualwinch.controllers.parts import Context, Coordination, CoordinationOutput, Estimate
from dualwinch.model.quantities.quantity import Positive, Quantity, Tied, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class ProportionalState:
    """State of the low-pass and of both tension controllers."""

    loops: TensionLoops = field(default_factory=TensionLoops)
    slow: Annotated[Scalar, Quantity("N", "slow part of the force")] = 0.0


@dataclass(frozen=True)
class ProportionalTension(Coordination):
    """Both winches follow tension commands: a slow difference about the preload, and proportional fast changes."""

    slow_time: Annotated[
        Positive, Quantity("s", "low-pass that separates slow from fast force", "by hand"), Tunable(0.05, 2)
    ] = 0.3
    winch_1: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)
    winch_2: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)

    kind: ClassVar = "proportional-tension"
    label: ClassVar = "proportional tension"

    def initial_state(self) -> ProportionalState:
        """Empty integrals, and no slow force."""
        return ProportionalState(TensionLoops.of(self.winch_1, self.winch_2))

    def step(
        self, state: ProportionalState, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[ProportionalState, CoordinationOutput]:
        """One sample of both winches."""
        slow = state.slow + context.sample_time / (self.slow_time + context.sample_time) * (force - state.slow)
        slow_1, slow_2 = tension_commands(slow, context.limits)
        fast, share = force - slow, slow_1 / (slow_1 + slow_2)
        commands = within_limits(slow_1 + share * fast, slow_2 - (1 - share) * fast, context.limits)
        gains = self.winch_1, self.winch_2
        loops, output = follow_tensions(state.loops, commands, estimate, gains, setpoint, context)
        return ProportionalState(loops, slow), output
