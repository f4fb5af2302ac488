"""No estimator: the position law sees the sensors."""

from dataclasses import dataclass
from typing import ClassVar

from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.model.actuators import NoState
from dualwinch.model.reference import Setpoint


@dataclass(frozen=True)
class Unfiltered(Estimator):
    """Passes the measurement on as it is."""

    kind: ClassVar = "none"
    label: ClassVar = "no estimator"

    def initial_state(self) -> NoState:
        """Nothing."""
        return NoState()

    def step(
        self, state: NoState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[NoState, Estimate]:
        """The measurement as it is."""
        return state, Estimate(**vars(measurement))
