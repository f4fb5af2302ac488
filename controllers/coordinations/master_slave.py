"""Master–slave coordination: winch 1 follows a speed, winch 2 follows winch 1.

The paper describes it as what it argues against (Section 1.1): the motion of the master is the reference of the slave,
which adjusts itself to achieve synchronisation. No tension is measured.

Ours is how the force command enters, so that every position law can be combined with it: it is the master's torque
feedforward, on top of half the preload, and a speed PI makes drum 1 follow the reference speed corrected by the
position error. The slave holds half the preload as a torque feedforward and follows the measured speed of drum 1 with
the opposite sign, by a proportional gain: an integral would keep the sum of both stretches as it was, and so slacken
rope 2 whenever rope 1 pulls. What one rope's limit takes from the feedforwards goes to the other.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import annotated_types as at

from dualwinch.controllers.limits import Coordination, CoordinationOutput, within_limits
from dualwinch.controllers.signals import Measurement
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, clip, either, where
from dualwinch.model.winch import Winch

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class MasterSlaveGains:
    """Gains of the master's speed loop and of the slave's synchronisation."""

    position: Annotated[
        float,
        at.Ge(0),
        Quantity("1/s", "master: speed asked for by a metre of position error", "by hand"),
        Tunable(0.05, 20),
    ] = 1.0
    kp: Annotated[
        float,
        at.Ge(0),
        Quantity("N m s/rad", "master: proportional gain on the drum speed", "by hand"),
        Tunable(0.1, 100),
    ] = 5.0
    ki: Annotated[
        float, at.Ge(0), Quantity("N m/rad", "master: integral gain on the drum speed", "by hand"), Tunable(0.1, 200)
    ] = 10.0
    synchronisation: Annotated[
        float,
        at.Ge(0),
        Quantity("N m s/rad", "slave: gain on the difference of the drum speeds", "by hand"),
        Tunable(0.1, 100),
    ] = 5.0


@dataclass(frozen=True)
class MasterSlaveState:
    """State of the master's speed loop."""

    angle: Annotated[Scalar, Quantity("rad", "integral of the master's speed error")] = 0.0


def _limited(torque: Scalar, winch: Winch, limits: Coordination) -> Scalar:
    lever = winch.drum_radius / winch.gear_ratio
    return clip(torque, lever * limits.tension_min, lever * limits.tension_max)


def master_slave_step(
    state: MasterSlaveState,
    u_sat: Scalar,
    measurement: Measurement,
    setpoint: Setpoint,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[MasterSlaveState, CoordinationOutput]:
    """One sample: the commands are the tensions the feedforwards stand for; the torques are limited as everywhere."""
    gains, limits = controller.master_slave, controller.coordination
    master, slave = nominal.winch_1, nominal.winch_2
    F1_cmd, F2_cmd = within_limits(limits.preload / 2 + u_sat, limits.preload / 2, limits)

    def feedforward(force: Scalar, acceleration: Scalar, winch: Winch) -> Scalar:
        return (winch.drum_radius * force + winch.inertia * acceleration / winch.drum_radius) / winch.gear_ratio

    wanted_speed = setpoint.v - gains.position * (measurement.x - setpoint.x)
    error = wanted_speed / master.drum_radius - measurement.omega_1
    angle = state.angle + sample_time * error
    wanted_1 = feedforward(F1_cmd, setpoint.a, master) + gains.kp * error + gains.ki * angle
    tau1 = _limited(wanted_1, master, limits)

    difference = -measurement.omega_1 * master.drum_radius / slave.drum_radius - measurement.omega_2
    wanted_2 = feedforward(F2_cmd, -setpoint.a, slave) + gains.synchronisation * difference
    tau2 = _limited(wanted_2, slave, limits)

    following = MasterSlaveState(where(tau1 == wanted_1, angle, state.angle))
    return following, CoordinationOutput(F1_cmd, F2_cmd, tau1, tau2, either(tau1 != wanted_1, tau2 != wanted_2))
