"""Scheduled preload: differential tension whose sum of tensions follows what the motion asks for.

The paper keeps the sum of both tensions constant (Section 3.2): it has to be large enough for the largest force of the
run, and loads both motors with it all the time. Least load is the rope behind held just above its lower limit, and the
rope in front pulling as much more as the force: a sum of |force| + 2 × that tension.

Commanded so sample by sample, every tremor of the force would go to the rope in front alone, and a winch at its limit
cannot answer. So the sum follows a slow force instead, and the difference of both tensions stays the force itself,
shared by both ropes as ever: around any moment the loop is that of a constant preload. The slow force is what the
nominal vehicle needs on its reference, which is known at once and free of noise, and the low-passed rest of the force
command: disturbances, and what the nominal plant gets wrong. The sum falls no faster than a given rate, so that it
waits for an oscillating force instead of following it. It rises at once, but for what the reference is known to ask for
within a horizon, which it rises to beforehand at the same rate. With all known, that is the least sum of such a rate
that is large enough.

The force's reach stays what it is: where the sum is too small or too large for a force, the limits of the two commands
change it, as they do a constant preload.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.controllers.coordinations.differential_tension import TensionLoops, follow_tensions
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.limits import within_limits
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Coordination, CoordinationOutput, Estimate
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Tied, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, absolute, maximum

LOOKS = 5
"""Times ahead at which the reference is looked at, evenly over the horizon."""


@dataclass(frozen=True)
class ScheduleState:
    """State of the schedule and of both tension controllers."""

    loops: TensionLoops = field(default_factory=TensionLoops)
    unforeseen: Annotated[Scalar, Quantity("N", "slow part of the force that the reference does not explain")] = 0.0
    preload: Annotated[Scalar, Quantity("N", "sum of both tensions asked for in the last sample")] = 0.0


@dataclass(frozen=True)
class ScheduleOutput(CoordinationOutput):
    """What the coordination gives."""

    preload: Annotated[Scalar, Quantity("N", "sum of both tensions that the schedule asks for")]


@dataclass(frozen=True)
class ScheduledPreload(Coordination):
    """The schedule, and the tension controllers that follow it; the shared preload is the least sum."""

    margin: Annotated[
        NonNegative,
        Quantity("N", "tension above tension_min that is left to the rope behind", "by hand"),
        Tunable(50, 1500, of="controller.coordination.tension_max"),
    ] = 300.0
    filter_time: Annotated[
        NonNegative,
        Quantity("s", "low-pass on the force that the reference does not explain", "by hand"),
        Tunable(0.05, 5),
    ] = 0.3
    rate: Annotated[
        Positive,
        Quantity("N/s", "how fast the sum of tensions falls at most, and rises to what is foreseen", "by hand"),
        Tunable(100, 5000, of="controller.coordination.tension_max"),
    ] = 1500.0
    horizon: Annotated[
        NonNegative,
        at.Le(10),
        Quantity("s", "how far ahead the reference is known; 0: not at all", "by hand"),
        Mark.SHAPES_CODE,
    ] = 0.0
    winch_1: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)
    winch_2: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)

    kind: ClassVar = "scheduled-preload"
    label: ClassVar = "scheduled preload"

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead at which the reference is looked at."""
        times = (self.horizon * (number + 1) / LOOKS for number in range(LOOKS))
        return tuple(time for time in times if time > 0)

    def initial_state(self) -> ScheduleState:
        """Empty integrals, and no force known."""
        return ScheduleState()

    def step(
        self, state: ScheduleState, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[ScheduleState, ScheduleOutput]:
        """One sample: how large the sum has to be, and both winches."""
        limits, sample_time = context.limits, context.sample_time
        foreseen = _force(setpoint, context)
        learning = sample_time / (self.filter_time + sample_time)
        unforeseen = state.unforeseen + learning * (force - foreseen - state.unforeseen)
        behind = limits.tension_min + self.margin
        needed = absolute(foreseen + unforeseen)
        for time in self.preview:
            ahead = absolute(_force(setpoint.ahead(time), context) + unforeseen)
            needed = maximum(needed, ahead - self.rate * time)
        wanted = maximum(needed + 2 * behind, limits.preload)
        preload = maximum(wanted, state.preload - sample_time * self.rate)
        commands = within_limits((preload + force) / 2, (preload - force) / 2, limits)
        gains = self.winch_1, self.winch_2
        loops, winches = follow_tensions(state.loops, commands, estimate, gains, setpoint, context)
        following = ScheduleState(loops, unforeseen, preload)
        return following, ScheduleOutput(**vars(winches), preload=preload)


def _force(setpoint: Setpoint, context: Context) -> Scalar:
    """Force in N that keeps the nominal vehicle on its reference."""
    forces = nominal_forces(setpoint.v, 0.0, context.nominal)
    return forces.mass * setpoint.a + forces.resistance
