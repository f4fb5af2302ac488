"""A position law of one's own: an LQI, whose gains solve a Riccati equation of its weights."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at
import casadi as ca

import dualwinch as dw


@dataclass(frozen=True)
class Integral:
    """State of the law."""

    value: Annotated[float, dw.Quantity("m s", "integral of the tracking error")] = 0.0


@dataclass(frozen=True)
class Lqi(dw.PositionLaw):
    """Optimal for a mass under an unknown constant force: what it weighs are errors one would put up with."""

    x: Annotated[float, at.Gt(0), dw.Quantity("m", "position error, weight 1"), dw.Tunable(1e-5, 1e-2)] = 2e-3
    v: Annotated[float, at.Gt(0), dw.Quantity("m/s", "speed error, weight 1"), dw.Tunable(1e-4, 1)] = 1e-2
    s: Annotated[float, at.Gt(0), dw.Quantity("m s", "integral of the error, weight 1"), dw.Tunable(1e-5, 1e-2)] = 1e-3
    a: Annotated[float, at.Gt(0), dw.Quantity("m/s^2", "acceleration, weight 1"), dw.Tunable(1e-3, 10)] = 0.1

    kind: ClassVar = "my-lqi"
    label: ClassVar = "LQI"

    def initial_state(self):
        return Integral()

    def step(self, state, estimate, setpoint, context):
        T, e, e_v = context.sample_time, estimate.x - setpoint.x, estimate.v - setpoint.v
        gain = riccati_gain(T, ca.vertcat(self.s, self.x, self.v) ** -2, self.a**2)
        forces = dw.nominal_forces(estimate.v, estimate.d, context.nominal)
        u = forces.mass * (setpoint.a - ca.dot(gain.T, ca.vertcat(state.value, e, e_v))) + forces.resistance
        u_sat = dw.clip(u, -context.limits.force, context.limits.force)
        held = dw.where(u_sat == u, T * e, 0.0)  # the integral waits while the force is at its limit
        return Integral(state.value + held), dw.PositionOutput(u, u_sat)


def riccati_gain(T, weights, variance):
    """Gain (1 x 3) of integral, error and speed error; it depends on gains alone, so it is computed once a run."""
    A = ca.vertcat(ca.horzcat(1, T, T**2 / 2), ca.horzcat(0, 1, T), ca.horzcat(0, 0, 1))
    B = ca.vertcat(T**3 / 6, T**2 / 2, T)
    a, g, h = A, variance * B @ B.T, ca.diag(weights)
    for _ in range(16):  # structure-preserving doubling: 2^16 steps of the Riccati recursion
        w = ca.inv_minor(ca.DM.eye(3) + g @ h)
        a, g, h = a @ w @ a, g + a @ w @ g @ a.T, h + a.T @ h @ w @ a
    return (B.T @ h @ A) / (1 / variance + B.T @ h @ B)


def main(trials: int = 144, out: str = "lqi") -> None:
    """Tune law and filter in a noisy sea, compare them with the paper's controller, write their C."""
    start = dw.case(4, law=Lqi(), estimator=dw.CalibratingKalman())
    tuned = dw.tune(dw.tuning_problem(start, ensemble="sea"), trials=trials)
    print(tuned)
    contenders = {"paper": dw.paper_controller(), "LQI": start.controller, "tuned": tuned.best.controller}
    print(dw.compare(contenders, dw.load_ensemble("sea"), scenarios=40, seed=7))
    print("wrote", *dw.export_c(tuned.best, out))


if __name__ == "__main__":
    main()
