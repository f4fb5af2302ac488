"""Scheduled preload: differential tension with a sum of tensions that follows the required force.

The paper keeps the sum of both tensions constant (Section 3.2): it must suffice for the largest force of the run, and
loads both motors all the time. The load is least with the rope behind just above its lower limit, and the rope in front
higher by the force: a sum of |force| + 2 × that tension.

If the sum followed the force command itself, every fast change would go to the rope in front alone, and a winch at its
limit cannot respond. The sum therefore follows a slow force, while the difference of the tensions is the force itself,
shared by both ropes: at any moment the loop is that of a constant preload. The slow force is the sum of the force of
the nominal vehicle on its reference, which is known without delay and noise, and of the low-passed rest of the force
command: disturbances, and errors of the nominal plant. The sum falls at a limited rate, so that it does not follow an
oscillating force. It rises at once, except for the reference's demand within a horizon, for which it rises beforehand
at the same rate. With a fully known force that is the least sufficient sum of limited rate.

The range of the force is unchanged: where the sum is too small or too large for a force, the limits of the two commands
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
"""Number of preview times, evenly over the horizon."""


@dataclass(frozen=True)
class ScheduleState:
    """State of the schedule and of both tension controllers."""

    loops: TensionLoops = field(default_factory=TensionLoops)
    unforeseen: Annotated[Scalar, Quantity("N", "slow part of the force beyond that of the reference")] = 0.0
    preload: Annotated[Scalar, Quantity("N", "scheduled sum of both tensions in the last sample")] = 0.0


@dataclass(frozen=True)
class ScheduleOutput(CoordinationOutput):
    """Output of the coordination."""

    preload: Annotated[Scalar, Quantity("N", "scheduled sum of both tensions")]


@dataclass(frozen=True)
class ScheduledPreload(Coordination):
    """The schedule, and the tension controllers that follow it; ``preload`` of the limits is the least sum."""

    margin: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("1", "tension of the rope behind above tension_min, over tension_max", "by hand"),
        Tunable(0.01, 0.25),
    ] = 0.05
    filter_time: Annotated[
        NonNegative, Quantity("s", "low-pass on the force beyond that of the reference", "by hand"), Tunable(0.05, 5)
    ] = 0.3
    rate: Annotated[
        Positive,
        Quantity(
            "1/s", "largest rate at which the sum of tensions falls, and rises in advance, over tension_max", "by hand"
        ),
        Tunable(0.02, 1),
    ] = 0.25
    horizon: Annotated[
        NonNegative,
        at.Le(10),
        Quantity("s", "time ahead for which the reference is known; 0: no preview", "by hand"),
        Mark.SHAPES_CODE,
    ] = 0.0
    winch_1: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)
    winch_2: Annotated[WinchGains, Tied("winch")] = field(default_factory=WinchGains)

    kind: ClassVar = "scheduled-preload"
    label: ClassVar = "scheduled preload"

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead at which the reference is used."""
        times = (self.horizon * (number + 1) / LOOKS for number in range(LOOKS))
        return tuple(time for time in times if time > 0)

    def initial_state(self) -> ScheduleState:
        """Empty integrals, and zero force."""
        return ScheduleState(TensionLoops.of(self.winch_1, self.winch_2))

    def step(
        self, state: ScheduleState, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[ScheduleState, ScheduleOutput]:
        """One sample of the schedule and of both winches."""
        limits, sample_time = context.limits, context.sample_time
        foreseen = _force(setpoint, context)
        learning = sample_time / (self.filter_time + sample_time)
        unforeseen = state.unforeseen + learning * (force - foreseen - state.unforeseen)
        behind = limits.tension_min + self.margin * limits.tension_max
        rate = self.rate * limits.tension_max
        needed = absolute(foreseen + unforeseen)
        for time in self.preview:
            ahead = absolute(_force(setpoint.ahead(time), context) + unforeseen)
            needed = maximum(needed, ahead - rate * time)
        requirement = maximum(needed + 2 * behind, limits.preload)
        preload = maximum(requirement, state.preload - sample_time * rate)
        commands = within_limits((preload + force) / 2, (preload - force) / 2, limits)
        gains = self.winch_1, self.winch_2
        loops, winches = follow_tensions(state.loops, commands, estimate, gains, setpoint, context)
        following = ScheduleState(loops, unforeseen, preload)
        return following, ScheduleOutput(**vars(winches), preload=preload)


def _force(setpoint: Setpoint, context: Context) -> Scalar:
    """Force in N that keeps the nominal vehicle on its reference."""
    forces = nominal_forces(setpoint.v, 0.0, context.nominal)
    return forces.mass * setpoint.a + forces.resistance
