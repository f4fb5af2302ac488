"""What an integrator has to solve: the plant between two samples, torques and environment in a zero-order hold."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np

from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques, derivative
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.ropes import Rope, RopeLaw, Track, stiffness
from dualwinch.model.scalar import Scalar
from dualwinch.model.winch import Winch, base_radius


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
    environment: DisturbanceInputs
    disturbance: Disturbance
    plant: Plant

    def environment_at(self, t: Scalar, v: Scalar, phase: Scalar) -> DisturbanceInputs:
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


def swing_rate(rope: Rope, winch: Winch, track: Track) -> Any:
    """How fast in rad/s a Kelvin–Voigt rope and its drum swing, or settle, where the rope is shortest.

    An array where numbers of rope or winch are.
    """
    mobility = base_radius(winch) ** 2 / winch.inertia
    return np.maximum(np.sqrt(mobility * stiffness(track.rope_offset, rope)), mobility * rope.damping / 2)


@lru_cache(maxsize=1024)
def fastest_rate(rope: RopeLaw, winch: Winch, track: Track, tensions: tuple[float, ...]) -> float:
    """Largest rate in rad/s at which a rope of any law and its drum swing or settle, on the track under some tensions.

    The largest modulus of an eigenvalue of s'' = −mobility (spring s + damping s'), with the rope at its longest and at
    its shortest; NaN where the law does not reach a tension, or has no spring rate there.

    Args:
        rope: the rope.
        winch: its winch.
        track: says how long the rope is.
        tensions: in N.
    """
    mobility, fastest = base_radius(winch) ** 2 / winch.inertia, 0.0
    for length in (track.rope_offset, track.length + track.rope_offset):
        for tension in tensions:
            reached = rope.tension(rope.resting_stretch(tension, length), 0.0, length)
            spring, damping = rope.tangent(tension, length)
            if not math.isclose(reached, tension, rel_tol=1e-6) or not (
                math.isfinite(spring) and math.isfinite(damping) and spring > 0
            ):
                return math.nan
            square, decay = mobility * spring, mobility * abs(damping) / 2
            fastest = max(fastest, math.sqrt(square), decay + math.sqrt(max(decay**2 - square, 0.0)))
    return fastest
