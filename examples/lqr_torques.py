"""A law of one's own that commands torques: state feedback of vehicle and both drums, an LQR of the linear machine."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from scipy.linalg import solve_discrete_are

import dualwinch as dw


@dataclass(frozen=True)
class Feedforward(dw.PositionLaw):
    """The force that the reference needs; what is wrong with it is the feedback's."""

    kind: ClassVar = "feedforward"
    label: ClassVar = "full-state LQR"

    def initial_state(self):
        return dw.NoState()

    def step(self, state, estimate, setpoint, context):
        forces = dw.nominal_forces(setpoint.v, estimate.d, context.nominal)
        u = forces.mass * setpoint.a + forces.resistance
        return state, dw.PositionOutput(u, dw.clip(u, -context.limits.force, context.limits.force))


@dataclass(frozen=True)
class FullState(dw.Coordination):
    """Torques of both winches: half the preload and half the force each, and the gain on the errors of six states."""

    gain: Annotated[tuple[float, ...], dw.Quantity("1", "N m per m, m/s, rad, rad/s, rad, rad/s; winch 1, winch 2")]

    kind: ClassVar = "full-state"
    label: ClassVar = "full-state LQR"

    def initial_state(self):
        return dw.NoState()

    def step(self, state, force, estimate, setpoint, context):
        limits, sides = context.limits, context.nominal.sides
        levers = [side.winch.drum_radius / side.winch.gear_ratio for side in sides]
        errors = [estimate.x - setpoint.x, estimate.v - setpoint.v]
        drums = (estimate.theta_1, estimate.omega_1), (estimate.theta_2, estimate.omega_2)
        for side, (theta, omega) in zip(sides, drums, strict=True):
            turns = side.direction / side.winch.drum_radius
            errors += [theta - turns * setpoint.x, omega - turns * setpoint.v]
        wanted = []  # as tensions in N
        for number, (lever, share) in enumerate(zip(levers, (force, -force), strict=True)):
            feedback = sum(k * e for k, e in zip(self.gain[6 * number : 6 * number + 6], errors, strict=True))
            wanted.append((limits.preload + share) / 2 - feedback / lever)
        low, high = limits.tension_min, limits.command_max
        lacking = [dw.clip(tension, low, high) - tension for tension in wanted]  # the other rope takes it over
        given = [dw.clip(tension + lack, low, high) for tension, lack in zip(wanted, lacking[::-1], strict=True)]
        saturated = dw.where(lacking[0] ** 2 + lacking[1] ** 2 > 0, 1.0, 0.0)
        torques = [lever * tension for lever, tension in zip(levers, given, strict=True)]
        return state, dw.CoordinationOutput(given[0], given[1], torques[0], torques[1], saturated)


def lqr_gain(experiment, sizes=(2e-3, 1e-2, 1.0, 5.0, 1.0, 5.0), torque=2.0):
    """Gain (2 x 6), optimal amid the track for errors of these sizes, in SI units, and torques of this one in N m."""
    machine = dw.linearise(experiment, v=0.5, dt=experiment.simulation.sample_time)
    A, B = machine.A, machine.B[:, :2]
    weights, costs = np.diag(np.array(sizes) ** -2.0), np.eye(2) * torque**-2.0
    cost_to_go = solve_discrete_are(A, B, weights, costs)
    return np.linalg.solve(costs + B.T @ cost_to_go @ B, B.T @ cost_to_go @ A)


def lqr(experiment):
    """The experiment under the law."""
    gain = tuple(lqr_gain(experiment).ravel().tolist())
    parts = {"estimator": dw.Unfiltered(), "law": Feedforward(), "coordination": FullState(gain)}
    return replace(experiment, controller=replace(experiment.controller, **parts))


def main(out: str = "lqr") -> None:
    """Run all four cases, and write C."""
    for number in (1, 2, 3, 4):
        print(f"Case {number}:", dw.simulate(lqr(dw.case(number))))
    print("wrote", *dw.export_c(lqr(dw.case(4)), out))


if __name__ == "__main__":
    main()
