"""No estimator: the position law gets the sensor values."""

from dataclasses import dataclass
from typing import ClassVar

from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.model.actuators import NoState
from dualwinch.model.reference import Setpoint


@dataclass(frozen=True)
class Unfiltered(Estimator):
    """The measurement unchanged."""

    kind: ClassVar = "none"
    label: ClassVar = "no estimator"

    def initial_state(self) -> NoState:
        """No state."""
        return NoState()

    def step(
        self, state: NoState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[NoState, Estimate]:
        """The measurement unchanged."""
        return state, Estimate(**vars(measurement))
