"""The integration problem: the plant between two samples, with torques and environment in a zero-order hold."""

from dataclasses import dataclass, replace
from typing import Annotated

from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques, derivative
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Motion:
    """State between two samples: the plant, the phase of the vortex shedding, and an integrator's memory."""

    plant: PlantState
    phase: Annotated[Scalar, Quantity("rad", "integral of the vortex frequency"), Mark.BOOKKEEPING] = 0.0
    slow: Annotated[Scalar, Quantity("m/s^2", "acceleration due to all but the ropes at the last mid-step")] = 0.0


@dataclass(frozen=True)
class Problem:
    """The plant over one sample.

    Attributes:
        t: time of the sample's beginning in s.
        duration: length of the sample in s.
        torques: motor torques, constant over the sample (zero-order hold).
        environment: current and rail load, also constant; its force is added to the vortex force.
        disturbance: the vortex shedding.
        plant: parameters.
    """

    t: Scalar
    duration: Scalar
    torques: Torques
    environment: DisturbanceInputs
    disturbance: Disturbance
    plant: Plant

    def environment_at(self, t: Scalar, v: Scalar, phase: Scalar) -> DisturbanceInputs:
        """The environment with the vortex force at the time t in s and the speed v in m/s."""
        vortex = vortex_force(t, v, phase, self.disturbance, self.plant.vehicle)
        return replace(self.environment, force=self.environment.force + vortex)

    def derivative(self, t: Scalar, motion: Motion, step: Scalar = 0.0) -> Motion:
        """Time derivative of the motion at t in s; of friction states over a step in s (`model.plant.derivative`)."""
        state = motion.plant
        environment = self.environment_at(t, state.v, motion.phase)
        return Motion(
            plant=derivative(state, self.torques, environment, self.plant, t, step),
            phase=vortex_frequency(state.v, self.disturbance, self.plant.vehicle),
        )
