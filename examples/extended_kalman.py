"""An estimator of one's own: an extended Kalman filter, its Jacobian taken by CasADi."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import annotated_types as at
import casadi as ca
import numpy as np

import dualwinch as dw


@dataclass(frozen=True)
class Belief:
    """State of the filter: what it expects of the coming sample."""

    z: Annotated[Any, dw.Quantity("1", "position in m, speed in m/s, disturbance in m/s^2")] = field(
        default_factory=lambda: np.zeros(3)
    )
    P: Annotated[Any, dw.Quantity("1", "covariance of these")] = field(default_factory=lambda: 1e-6 * np.eye(3))


@dataclass(frozen=True)
class ExtendedKalman(dw.Estimator):
    """Position, speed and a wandering disturbance from position and speed sensor, friction and drag linearised."""

    x: Annotated[float, at.Gt(0), dw.Quantity("m", "noise of the position"), dw.Tunable(1e-5, 1e-2)] = 6e-4
    v: Annotated[float, at.Gt(0), dw.Quantity("m/s", "noise of the speed"), dw.Tunable(1e-4, 1e-1)] = 2e-3
    wander: Annotated[float, at.Gt(0), dw.Quantity("m/s^2.5", "random walk of d"), dw.Tunable(1e-3, 10)] = 0.3

    kind: ClassVar = "extended-kalman"
    label: ClassVar = "extended Kalman filter"

    def initial_state(self):
        return Belief()

    def step(self, state, measurement, setpoint, context):
        T, R = context.sample_time, ca.diag(ca.vertcat(self.x, self.v) ** 2)
        gain = state.P[:, :2] @ ca.inv_minor(state.P[:2, :2] + R)
        z = state.z + gain @ (ca.vertcat(measurement.x, measurement.v) - state.z[:2])
        point = ca.SX.sym("z", 3)  # the model at a symbol, differentiated, then taken at the estimate
        forces = dw.nominal_forces(point[1], point[2], context.nominal)
        acceleration = (measurement.F1 - measurement.F2 - forces.resistance) / forces.mass
        ahead = point + T * ca.vertcat(point[1] + T / 2 * acceleration, acceleration, 0)
        z_next, F = ca.substitute([ahead, ca.jacobian(ahead, point)], [point], [z])
        P = F @ (state.P - gain @ state.P[:2, :]) @ F.T + ca.diag(ca.vertcat(0, 0, T * self.wander**2))
        return Belief(z_next, P), dw.Estimate(**vars(measurement) | {"x": z[0], "v": z[1], "d": z[2]})


def main(trials: int = 144, out: str = "extended-kalman") -> None:
    """Tune filter and law in a noisy sea, compare them with the paper's controller, write their C."""
    start = dw.case(4, estimator=ExtendedKalman())
    tuned = dw.tune(dw.tuning_problem(start, ensemble="sea"), trials=trials)
    print(tuned)
    contenders = {"paper": dw.paper_controller(), "filter": start.controller, "tuned": tuned.best.controller}
    print(dw.compare(contenders, dw.load_ensemble("sea"), scenarios=40, seed=7))
    print("wrote", *dw.export_c(tuned.best, out))


if __name__ == "__main__":
    main()
