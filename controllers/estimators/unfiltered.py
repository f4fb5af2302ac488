"""No estimator: the position law sees the sensors."""

from dataclasses import dataclass
from typing import ClassVar

from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.model.reference import Setpoint


@dataclass(frozen=True)
class Stateless:
    """State of what remembers nothing."""


@dataclass(frozen=True)
class Unfiltered(Estimator):
    """Passes the measurement on as it is."""

    kind: ClassVar = "none"
    label: ClassVar = "no estimator"

    def initial_state(self) -> Stateless:
        """Nothing."""
        return Stateless()

    def step(
        self,
        state: Stateless,
        measurement: Measurement,
        setpoint: Setpoint,
        context: Context,
    ) -> tuple[Stateless, Estimate]:
        """The measurement as it is."""
        return state, Estimate(**vars(measurement))
