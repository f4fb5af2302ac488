"""What an estimator is."""

from abc import abstractmethod
from typing import Any

from dualwinch.controllers.context import Context
from dualwinch.controllers.signals import Estimate, Measurement
from dualwinch.model.quantities.part import Part
from dualwinch.model.reference import Setpoint


class Estimator(Part):
    """From sensor values to what the position law takes for the motion: a frozen dataclass of its own gains."""

    @abstractmethod
    def initial_state(self) -> Any:
        """State before the first sample: a dataclass of floats, vectors and matrices; it may depend on the gains."""

    @abstractmethod
    def step(self, state: Any, measurement: Measurement, setpoint: Setpoint, context: Context) -> tuple[Any, Estimate]:
        """One sample, over floats or CasADi symbols.

        Args:
            state: as the last sample left it.
            measurement: this sample's sensor values.
            setpoint: this sample's reference position, speed and acceleration.
            context: nominal plant, limits and sample time.

        Returns:
            The next state and the estimate.
        """
