"""The integration problem: the plant between two samples, with torques and environment in a zero-order hold."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np

from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.heavy_ropes import end_mass, is_heavy, lumped_mass
from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques, derivative
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.ropes import Rope, RopeLaw, Track, stiffness, viscosity
from dualwinch.model.scalar import Scalar, present
from dualwinch.model.vehicle import Vehicle, inertia
from dualwinch.model.winch import Winch, base_radius, total_inertia


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


def swing_rate(rope: Rope, winch: Winch, track: Track) -> Any:
    """Largest rate in rad/s at which the shortest Kelvin–Voigt rope, its drum and its rotor oscillate or settle.

    An array if numbers of rope or winch are arrays.
    """
    if is_heavy(rope) or present(winch.gear_stiffness):
        return _chain_rate(rope, winch, track)
    mobility = base_radius(winch) ** 2 / total_inertia(winch)
    return np.maximum(np.sqrt(mobility * _spring_rate(track.rope_offset, rope)), mobility * viscosity(rope) / 2)


def bristle_swing_rate(vehicle: Vehicle) -> Any:
    """Rate in rad/s at which a vehicle oscillates or settles on the bristles of its rail; may be an array."""
    mass = inertia(vehicle)
    return np.maximum(np.sqrt(vehicle.bristle_stiffness / mass), vehicle.bristle_damping / mass)


def _spring_rate(length: Any, rope: Rope) -> Any:
    """Largest spring rate in N/m of a rope of a length in m, from its law and from its hysteresis at reversals."""
    return stiffness(length, rope) + 2 * rope.hysteresis / (rope.hysteresis_strain * length)


def _chain_rate(rope: Rope, winch: Winch, track: Track) -> Any:
    """Largest natural frequency in rad/s of the chain rotor – gear – drum – rope nodes – vehicle at rest."""
    length, radius = track.rope_offset, base_radius(winch)
    waves, gives = present(rope.mass_per_length), present(winch.gear_stiffness)
    nodes = rope.segments - 1 if waves else 0
    inner = np.asarray(lumped_mass(rope, np.asarray(length))) if nodes else 1.0
    drum = (winch.inertia if gives else total_inertia(winch)) / radius**2 + end_mass(rope, np.asarray(length))
    masses = [winch.gear_ratio**2 * winch.rotor_inertia / radius**2] * gives + [drum] + [inner] * nodes
    springs = [winch.gear_stiffness / radius**2] * gives + [(nodes + 1) * _spring_rate(length, rope)] * (nodes + 1)
    shape, size = np.broadcast_shapes(*map(np.shape, (*masses, *springs))), len(masses)
    scaled = np.zeros((*shape, size, size))  # stiffness matrix scaled by the square roots of the masses
    for place, (mass, spring) in enumerate(zip(masses, springs, strict=True)):
        scaled[..., place, place] += spring / mass
        if place + 1 < size:
            following = masses[place + 1]
            scaled[..., place + 1, place + 1] += spring / following
            scaled[..., place, place + 1] -= spring / (np.sqrt(mass) * np.sqrt(following))
            scaled[..., place + 1, place] = scaled[..., place, place + 1]
    finite = np.asarray(np.isfinite(scaled).all(axis=(-2, -1)))
    largest = np.linalg.eigvalsh(np.where(finite[..., None, None], scaled, 0.0))[..., -1]
    return np.where(finite, np.sqrt(np.maximum(largest, 0.0)), np.inf)


@lru_cache(maxsize=1024)
def fastest_rate(rope: RopeLaw, winch: Winch, track: Track, tensions: tuple[float, ...]) -> float:
    """Largest rate in rad/s at which a rope of any law and its drum oscillate or settle at given tensions.

    The largest magnitude of an eigenvalue of s'' = −mobility (spring s + damping s'), for the longest and the shortest
    rope; NaN if the law does not reach a tension, or has no spring rate there.

    Args:
        rope: the rope.
        winch: its winch.
        track: determines the rope's lengths.
        tensions: in N.
    """
    mobility, fastest = base_radius(winch) ** 2 / total_inertia(winch), 0.0
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
