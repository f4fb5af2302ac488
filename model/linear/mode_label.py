"""What a mode is called: which bodies move in it, and which ropes are stretched."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant, PlantState
from dualwinch.model.quantities.description import describe
from dualwinch.model.ropes.track import rope_lengths
from dualwinch.model.steady_cruise import PRELOAD
from dualwinch.model.vehicle import inertia

RIGID = 0.05
"""A mode is rigid where the ropes stretch by less than this share of the largest displacement."""

TAKES_PART = 0.2
"""A body (a rope) takes part with this share of the kinetic energy (the elastic energy), or more."""


class Shape(NamedTuple):
    """A mode of the plant in metres: complex displacements along the track, the drums' at their rims."""

    vehicle: complex
    drum_1: complex
    drum_2: complex

    @property
    def stretches(self) -> tuple[complex, complex]:
        """Stretches of rope 1 and rope 2."""
        return self.drum_1 - self.vehicle, self.vehicle - self.drum_2


def label(system: LinearSystem, participation: Mapping[str, float], shape: Mapping[str, complex], plant: Plant) -> str:
    """A mode's name in words.

    Args:
        system: whose mode it is.
        participation: state → its share in the mode.
        shape: state → complex amplitude.
        plant: parameters of the plant that was linearised.
    """
    prefix = plant_prefix(system.states)
    x = system.operating_point.get("x")
    if prefix is None or x is None or sum(participation[prefix + name] for name in describe(PlantState)) < 0.5:
        return _by_states(participation)
    moved = displacements(shape, plant, prefix)
    largest = max(map(abs, moved))
    if max(map(abs, moved.stretches)) < RIGID * largest:
        speed, position = participation[prefix + "v"], participation[prefix + "x"]
        return "rigid drift: speed" if speed > position else "rigid drift: position"
    springs = _springs(plant, x, system.operating_point)
    return _by_energies(moved, plant, springs)


def plant_prefix(states: Sequence[str]) -> str | None:
    """What stands before the names of the plant's six states; None where they are not all there."""
    for name in states:
        prefix = name.removesuffix("theta_1")
        if prefix != name and all(prefix + state in states for state in describe(PlantState)):
            return prefix
    return None


def displacements(shape: Mapping[str, complex], plant: Plant, prefix: str = "") -> Shape:
    """A mode's displacements of vehicle and drum rims along the track, in metres."""
    return Shape(
        shape[prefix + "x"],
        plant.winch_1.drum_radius * shape[prefix + "theta_1"],
        -plant.winch_2.drum_radius * shape[prefix + "theta_2"],
    )


def _springs(plant: Plant, x: float, point: Mapping[str, float]) -> tuple[float, float]:
    """Spring rates in N/m of both ropes at an operating point."""
    length_1, length_2 = rope_lengths(x, plant.track)
    tension_1, tension_2 = (point.get(name, PRELOAD / 2) for name in ("F1", "F2"))
    return plant.rope_1.tangent(tension_1, length_1)[0], plant.rope_2.tangent(tension_2, length_2)[0]


def _by_energies(moved: Shape, plant: Plant, springs: tuple[float, float]) -> str:
    masses = (
        inertia(plant.vehicle),
        plant.winch_1.inertia / plant.winch_1.drum_radius**2,
        plant.winch_2.inertia / plant.winch_2.drum_radius**2,
    )
    vehicle, *drums = _taking_part(masses, moved)
    ropes = [number for number, there in enumerate(_taking_part(springs, moved.stretches), start=1) if there]
    turning = [number for number, there in enumerate(drums, start=1) if there]
    rope = "both ropes" if len(ropes) == 2 else f"rope {ropes[0]}"
    drum = "both drums" if len(turning) == 2 else f"drum {turning[0]}" if turning else ""
    if len(turning) == 2 and not vehicle:
        together = (moved.drum_1 * moved.drum_2.conjugate()).real > 0
        return "both drums " + ("together" if together else "opposed")
    if not vehicle:
        return f"{rope} – {drum}"
    return f"vehicle on {rope}" + (f", with {drum}" if drum else "")


def _taking_part(weights: Sequence[float], amplitudes: Sequence[complex]) -> list[bool]:
    energies = [weight * abs(amplitude) ** 2 for weight, amplitude in zip(weights, amplitudes, strict=True)]
    return [energy >= TAKES_PART * sum(energies) for energy in energies]


def _by_states(participation: Mapping[str, float]) -> str:
    first, *others = sorted(participation.items(), key=lambda item: -item[1])
    names = [first[0], *(name for name, share in others[:2] if share > first[1] / 3)]
    return ", ".join(names)
