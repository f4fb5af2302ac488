"""An actuator of one's own: a motor that lags behind its command, and whose supply gives less torque at speed."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at
import casadi as ca

import dualwinch as dw


@dataclass(frozen=True)
class Torque:
    """State of one motor."""

    now: Annotated[float, dw.Quantity("N m", "torque of the motor")] = 0.0


@dataclass(frozen=True)
class ServoMotor(dw.Actuator):
    """First-order lag; the torque that can be had falls from stall to none at the no-load speed."""

    lag: Annotated[float, at.Gt(0), dw.Quantity("s", "time constant of the current loop")] = 0.004
    stall: Annotated[float, at.Gt(0), dw.Quantity("N m", "largest torque at rest")] = 200.0
    no_load: Annotated[float, at.Gt(0), dw.Quantity("rad/s", "speed without torque")] = 500.0

    kind: ClassVar = "servo-motor"

    def initial_state(self):
        return Torque()

    def holding_state(self, torque):
        return Torque(torque)

    def step(self, state, demand, sample_time):
        most = self.stall * (1 - abs(demand.speed) / self.no_load)
        gap = dw.clip(demand.torque, -most, most) - state.now
        moved = gap * (1 - ca.exp(-sample_time / self.lag))
        mean = state.now + gap - moved * self.lag / sample_time  # of the exponential, over the sample
        return Torque(state.now + moved), mean


def main(trials: int = 144, out: str = "servo") -> None:
    """Tune in a noisy sea with such motors, compare the gains with the paper's there, write the controller's C."""
    start = dw.case(4, actuator=ServoMotor(), estimator=dw.CalibratingKalman())
    sea = dw.load_ensemble("sea", start)
    tuned = dw.tune(dw.tuning_problem(ensemble=sea), trials=trials)
    print(tuned)
    print(dw.compare({"paper": dw.paper_controller(), "tuned": tuned.best.controller}, sea, scenarios=40, seed=7))
    print("wrote", *dw.export_c(tuned.best, out))


if __name__ == "__main__":
    main()
