"""What a coordination is."""

from abc import abstractmethod
from typing import Any

from dualwinch.controllers.context import Context
from dualwinch.controllers.signals import CoordinationOutput, Estimate
from dualwinch.model.quantities.part import Part
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


class Coordination(Part):
    """From the position law's force to the torques of both winches: a frozen dataclass of its own gains."""

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead at which the step looks by ``setpoint.ahead``; they may follow from what shapes code."""
        return ()

    @abstractmethod
    def initial_state(self) -> Any:
        """State before the first sample: a dataclass of floats, vectors and matrices; it may depend on the gains."""

    @abstractmethod
    def step(
        self, state: Any, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[Any, CoordinationOutput]:
        """One sample, over floats or CasADi symbols.

        Args:
            state: as the last sample left it.
            force: net force in N that the ropes are to give, within ± ``context.limits.force``.
            estimate: what the estimator gives of this sample, measured tensions among it.
            setpoint: this sample's reference position, speed and acceleration.
            context: nominal plant, limits and sample time.

        Returns:
            The next state, and tension commands in N with motor torques in N m.
        """
