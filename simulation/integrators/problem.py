"""What an integrator has to solve: the plant between two samples, torques and environment in a zero-order hold."""

from dataclasses import dataclass, replace
from typing import Annotated

from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.plant import Environment, Plant, PlantState, Torques, derivative
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Motion:
    """What moves between two samples: the plant, the phase of the vortex shedding, and an integrator's memory."""

    plant: PlantState
    phase: Annotated[Scalar, Quantity("rad", "integral of the vortex frequency"), Mark.BOOKKEEPING] = 0.0
    slow: Annotated[Scalar, Quantity("m/s^2", "acceleration by all but the ropes amid the last step")] = 0.0


@dataclass(frozen=True)
class Problem:
    """The plant over one sample.

    Attributes:
        t: time of the sample's beginning in s.
        duration: length of the sample in s.
        torques: what the motors give, constant over the sample (zero-order hold).
        environment: current and rail load, likewise constant; its force is added to the vortex force.
        disturbance: the vortex shedding.
        plant: parameters.
    """

    t: Scalar
    duration: Scalar
    torques: Torques
    environment: Environment
    disturbance: Disturbance
    plant: Plant

    def environment_at(self, t: Scalar, v: Scalar, phase: Scalar) -> Environment:
        """The environment with the vortex force at the time t in s and the speed v in m/s."""
        vortex = vortex_force(t, v, phase, self.disturbance, self.plant.vehicle)
        return replace(self.environment, force=self.environment.force + vortex)

    def derivative(self, t: Scalar, motion: Motion) -> Motion:
        """Time derivative of the motion at the time t in s."""
        state = motion.plant
        environment = self.environment_at(t, state.v, motion.phase)
        return Motion(
            plant=derivative(state, self.torques, environment, self.plant, t),
            phase=vortex_frequency(state.v, self.disturbance, self.plant.vehicle),
        )
