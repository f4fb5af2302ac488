"""Differential-tension coordination: one force command becomes two tension commands (paper Sections 3.2, 3.3, E11)."""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

from dualwinch.controllers.coordinations.command_shaping import drum_resonance
from dualwinch.controllers.coordinations.winch_pid import DrumMotion, WinchGains, WinchState, winch_step
from dualwinch.controllers.limits import Limits, within_limits
from dualwinch.controllers.parts import Context, Coordination, CoordinationOutput, Estimate
from dualwinch.model.drum_on_rope import drum_frequency, drum_impedance
from dualwinch.model.quantities.quantity import Tied
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import rope_lengths
from dualwinch.model.scalar import Scalar, either, present


@dataclass(frozen=True)
class TensionLoops:
    """State of the two winches' tension controllers."""

    winch_1: WinchState = field(default_factory=WinchState)
    winch_2: WinchState = field(default_factory=WinchState)

    @classmethod
    def of(cls, *winches: WinchGains) -> "TensionLoops":
        """Empty integrals, with the states that the gains of both winches need."""
        return cls(*(winch.initial_state() for winch in winches))


def tension_commands(u_sat: Scalar, limits: Limits) -> tuple[Scalar, Scalar]:
    """Commands F1_cmd and F2_cmd in N: half the preload plus and minus half the force (paper Section 3.2).

    The net force u_sat in N is within ± ``limits.force``.
    """
    return within_limits((limits.preload + u_sat) / 2, (limits.preload - u_sat) / 2, limits)


def follow_tensions(
    state: TensionLoops,
    commands: tuple[Scalar, Scalar],
    estimate: Estimate,
    gains: tuple[WinchGains, WinchGains],
    setpoint: Setpoint,
    context: Context,
) -> tuple[TensionLoops, CoordinationOutput]:
    """One sample of both tension controllers (paper Section 3.3), from tension commands in N."""
    steps, loops, track = [], (state.winch_1, state.winch_2), context.nominal.track
    measured = (estimate.F1, estimate.omega_1), (estimate.F2, estimate.omega_2)
    for side, loop, command, (tension, omega), length, pid in zip(
        context.nominal.sides, loops, commands, measured, rope_lengths(setpoint.x, track), gains, strict=True
    ):
        radius, turns = side.winch.drum_radius, side.direction / side.winch.drum_radius
        here, drum = pid.on(length, track), None
        if present(here.shaping):
            drum = drum_resonance(side, command, length, track, here.damping)
        motion = DrumMotion(turns * setpoint.a, omega - turns * setpoint.v, turns * (estimate.v - setpoint.v))
        if present(pid.damping):
            impedance = pid.share(length, track) * radius * drum_impedance(side, length, track)
            frequency = drum_frequency(side, command, length, track)
            motion = replace(motion, impedance=impedance, frequency=frequency)
        steps.append(winch_step(loop, command, tension, motion, side.winch, here, context, drum))
    (winch_1, tau_1, saturated_1), (winch_2, tau_2, saturated_2) = steps
    return TensionLoops(winch_1, winch_2), CoordinationOutput(*commands, tau_1, tau_2, either(saturated_1, saturated_2))


@dataclass(frozen=True)
class DifferentialTension(Coordination):
    """Both winches follow tension commands, whose sum is the preload and whose difference the force."""

    winch_1: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)
    winch_2: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)

    kind: ClassVar = "differential-tension"
    label: ClassVar = "differential tension"

    def initial_state(self) -> TensionLoops:
        """Empty integrals."""
        return TensionLoops.of(self.winch_1, self.winch_2)

    def step(
        self, state: TensionLoops, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[TensionLoops, CoordinationOutput]:
        """One sample of both winches."""
        commands = tension_commands(force, context.limits)
        return follow_tensions(state, commands, estimate, (self.winch_1, self.winch_2), setpoint, context)
