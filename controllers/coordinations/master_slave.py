"""Master–slave coordination: winch 1 follows a speed, winch 2 follows winch 1.

The paper describes it as the alternative it argues against (Section 1.1): the motion of the master is the reference of
the slave, which adjusts itself to achieve synchronisation. No tension is measured.

The entry of the force command is ours, so that every position law can be combined with it: it is the master's torque
feedforward, in addition to half the preload, and a speed PI controller makes drum 1 follow the reference speed
corrected by the position error. The slave has half the preload as a torque feedforward and follows the measured speed
of drum 1 with the opposite sign, by a proportional gain: an integral would keep the sum of both stretches constant, and
so slacken rope 2 whenever rope 1 pulls. The excess of one rope's feedforward over its limit goes to the other.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.limits import Limits, within_limits
from dualwinch.controllers.parts import Context, Coordination, CoordinationOutput, Estimate
from dualwinch.model.quantities.quantity import NonNegative, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, either, where
from dualwinch.model.winch import Winch, total_inertia

TORQUE_LIMIT = "controller.coordination.tension_max*plant.winch_{winch}.drum_radius/plant.winch_{winch}.gear_ratio"
"""Scale of gains from drum speeds to torques."""


@dataclass(frozen=True)
class MasterSlaveState:
    """State of the master's speed loop."""

    angle: Annotated[Scalar, Quantity("rad", "integral of the master's speed error")] = 0.0


def _limited(torque: Scalar, winch: Winch, limits: Limits) -> Scalar:
    lever = winch.drum_radius / winch.gear_ratio
    return clip(torque, lever * limits.tension_min, lever * limits.tension_max)


def _feedforward(force: Scalar, acceleration: Scalar, winch: Winch) -> Scalar:
    """Torque in N m for a tension in N and an acceleration of the rope in m/s²."""
    return (winch.drum_radius * force + total_inertia(winch) * acceleration / winch.drum_radius) / winch.gear_ratio


@dataclass(frozen=True)
class MasterSlave(Coordination):
    """Gains of the master's speed loop and of the slave's synchronisation."""

    position: Annotated[
        NonNegative, Quantity("1/s", "master: speed command per position error", "by hand"), Tunable(0.05, 20)
    ] = 1.0
    kp: Annotated[
        NonNegative,
        Quantity("N m s/rad", "master: proportional gain on the drum speed", "by hand"),
        Tunable(0.1, 100, of=TORQUE_LIMIT.format(winch=1)),
    ] = 5.0
    ki: Annotated[
        NonNegative,
        Quantity("N m/rad", "master: integral gain on the drum speed", "by hand"),
        Tunable(0.1, 200, of=TORQUE_LIMIT.format(winch=1)),
    ] = 10.0
    synchronisation: Annotated[
        NonNegative,
        Quantity("N m s/rad", "slave: gain on the difference of the drum speeds", "by hand"),
        Tunable(0.1, 100, of=TORQUE_LIMIT.format(winch=2)),
    ] = 5.0

    kind: ClassVar = "master-slave"
    label: ClassVar = "master–slave"

    def initial_state(self) -> MasterSlaveState:
        """An empty integral."""
        return MasterSlaveState()

    def step(
        self, state: MasterSlaveState, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[MasterSlaveState, CoordinationOutput]:
        """One sample; the tension commands are those of the feedforwards, the torques have the usual limits."""
        limits, sample_time = context.limits, context.sample_time
        master, slave = context.nominal.winch_1, context.nominal.winch_2
        F1_cmd, F2_cmd = within_limits(limits.preload / 2 + force, limits.preload / 2, limits)

        wanted_speed = setpoint.v - self.position * (estimate.x - setpoint.x)
        error = wanted_speed / master.drum_radius - estimate.omega_1
        angle = state.angle + sample_time * error
        wanted_1 = _feedforward(F1_cmd, setpoint.a, master) + self.kp * error + self.ki * angle
        tau_1 = _limited(wanted_1, master, limits)

        difference = -estimate.omega_1 * master.drum_radius / slave.drum_radius - estimate.omega_2
        wanted_2 = _feedforward(F2_cmd, -setpoint.a, slave) + self.synchronisation * difference
        tau_2 = _limited(wanted_2, slave, limits)

        following = MasterSlaveState(where(tau_1 == wanted_1, angle, state.angle))
        saturated = either(tau_1 != wanted_1, tau_2 != wanted_2)
        return following, CoordinationOutput(F1_cmd, F2_cmd, tau_1, tau_2, saturated)
