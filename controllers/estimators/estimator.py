"""What an estimator is."""

from abc import abstractmethod
from typing import Any, ClassVar

from dualwinch.controllers.context import Context
from dualwinch.controllers.signals import Estimate, Measurement
from dualwinch.model.quantities.part import Part
from dualwinch.model.reference import Setpoint


class Estimator(Part):
    """From sensor values to what the position law takes for the motion: a frozen dataclass of its own gains.

    One that does without a sensor while it is silent names it in `silent`: then the sensor's value may be no number
    (NaN), or be beyond `codegen.block.NO_READING` in magnitude, in exported controllers too.
    """

    silent: ClassVar[frozenset[str]] = frozenset()
    """Names of measurements that may be no number."""

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead at which the step looks by ``setpoint.ahead``; they may follow from what shapes code."""
        return ()

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
