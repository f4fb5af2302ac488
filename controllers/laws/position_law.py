"""What a position law is."""

from abc import abstractmethod
from typing import Any

from dualwinch.controllers.context import Context
from dualwinch.controllers.signals import Estimate, PositionOutput
from dualwinch.model.quantities.part import Part
from dualwinch.model.reference import Setpoint


class PositionLaw(Part):
    """From estimated motion and setpoint to a force on the vehicle: a frozen dataclass of the law's own gains."""

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead at which the step looks by ``setpoint.ahead``; they may follow from what shapes code."""
        return ()

    @abstractmethod
    def initial_state(self) -> Any:
        """State before the first sample: a dataclass of floats, vectors and matrices; it may depend on the gains."""

    @abstractmethod
    def step(self, state: Any, estimate: Estimate, setpoint: Setpoint, context: Context) -> tuple[Any, PositionOutput]:
        """One sample, over floats or CasADi symbols.

        Args:
            state: as the last sample left it.
            estimate: what the estimator gives of this sample.
            setpoint: this sample's reference position, speed and acceleration.
            context: nominal plant, limits and sample time.

        Returns:
            The next state and this sample's force in N, before saturation and within ± ``context.limits.force``.
        """
