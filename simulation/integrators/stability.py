"""Stability limits of the integrators: the rate of a plant whose product with the sub-step a method bounds.

One side of a plant, linearised at rest, is a chain rotor – gear – drum – rope nodes – vehicle, with the sag of the rope
as a further degree of freedom. With positions scaled by the square roots of their masses it is::

    q'' + C q' + B Bᵀ q = 0

where each spring is a column of B. Both sides share the vehicle, of which each is given half the mass: by Rayleigh's
quotient no mode of the whole is then faster than the fastest of the two sides.

- `pole_rate`, for the Runge–Kutta method: the largest magnitude of a solution s of s² + s C + B Bᵀ = 0.
- `leapfrog_rate`, for position Verlet with damping forces of the speed at the beginning of the step. Its mid-step
  positions y obey ``y⁺ − 2 y + y⁻ = −h² B Bᵀ y − h C (y − y⁻)``; a growing solution needs an eigenvalue of
  ``h² B Bᵀ + 2 h C`` above 4 (Jury's criterion for the Rayleigh quotients), which is h s > 2 for the largest solution s
  of s² = s C + B Bᵀ. A single mode has s = (c + sqrt(c² + 4 k))/2 per unit of mass.

Left out: friction whose force is limited, which cannot diverge, and drag, which vanishes at rest.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from dualwinch.model.heavy_ropes import LEAST_PULL, end_mass, lumped_mass, rope_on_drum, span_of, transverse_mass
from dualwinch.model.plant import Plant, Side
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.ropes import Rope, RopeLaw, Track, is_kelvin_voigt, kelvin_voigt, stiffness, viscosity
from dualwinch.model.scalar import present
from dualwinch.model.vehicle import Vehicle, inertia
from dualwinch.model.winch import Winch, base_radius, total_inertia

Rate: TypeAlias = Callable[["Chain"], Any]
"""A chain → its rate in rad/s; an array if the chain's matrices are stacks."""


@dataclass(frozen=True, eq=False)
class Chain:
    """A damped linear chain, ``q'' + damping q' + springs springsᵀ q = 0``, scaled by the masses.

    Damping (..., n, n) is in 1/s; springs (..., n, m) have a column for each, in rad/s.
    """

    damping: Any
    springs: Any


class RopeTangent(NamedTuple):
    """A rope at rest: its length in m, tension in N, spring rate in N/m and damping in N s/m; may be arrays."""

    length: Any
    tension: Any
    spring: Any
    damping: Any


def pole_rate(chain: Chain) -> Any:
    """Largest magnitude in rad/s of the solutions of s² + s C + B Bᵀ = 0; infinite if the chain is not finite."""
    return _over_finite(lambda matrix: np.abs(np.linalg.eigvals(matrix)).max(axis=-1), _companion(chain, -1))


def leapfrog_rate(chain: Chain) -> Any:
    """Largest solution in rad/s of s² = s C + B Bᵀ; infinite if the chain is not finite."""
    return _over_finite(lambda matrix: np.linalg.eigvalsh(matrix)[..., -1], _companion(chain, 1))


def _companion(chain: Chain, sign: int) -> Any:
    """The first-order form ``[[sign C, sign B], [Bᵀ, 0]]``."""
    *shape, n, m = chain.springs.shape
    matrix = np.zeros((*shape, n + m, n + m))
    matrix[..., :n, :n], matrix[..., :n, n:] = sign * chain.damping, sign * chain.springs
    matrix[..., n:, :n] = np.swapaxes(chain.springs, -1, -2)
    return matrix


def _over_finite(function: Callable[[Any], Any], matrix: Any) -> Any:
    finite = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))
    return np.where(finite, function(np.where(finite[..., None, None], matrix, 0.0)), np.inf)


def chain_of(side: Side, vehicle: Vehicle, track: Track, at: RopeTangent) -> Chain:
    """The chain of one side of a plant about a rope at rest, in displacements at the rim of the drum.

    Numbers may be arrays.
    """
    rope, winch = side.rope, side.winch
    gives, weighs = present(winch.gear_stiffness), present(rope.submerged_weight)
    length, radius = at.length, base_radius(winch)
    segments = rope.segments if present(rope.mass_per_length) else 1
    rotor = winch.gear_ratio**2 * winch.rotor_inertia / radius**2
    drum = winch.inertia / radius**2 + rope_on_drum(rope, length, track) + (0.0 if gives else rotor)
    towed = inertia(vehicle) / 2 + end_mass(rope, length)
    masses = [rotor] * gives + [drum] + [lumped_mass(rope, length)] * (segments - 1) + [towed]
    start, last, bend, depth = int(gives), int(gives) + segments, 0.0, len(masses)
    links: list[tuple[Any, Any, dict[int, Any]]] = [(0.0, winch.viscous_friction / radius**2, {start: 1.0})]
    if gives:
        links.append((winch.gear_stiffness / radius**2, winch.gear_damping / radius**2, {0: 1.0, start: -1.0}))
    if weighs:  # in each span d = w s²/(8 T); `heavy_ropes` has its equation of motion
        span = span_of(length, track)
        masses.append(8 / 15 * transverse_mass(rope) * length)
        bend = 16 / 3 * rope.submerged_weight / (8 * np.maximum(at.tension, LEAST_PULL)) * length
        links.append((16 / 3 * at.tension * length / span**2, 0.0, {depth: 1.0}))
    # at the drum the tension counts so many times
    pulling = np.sqrt((1 + np.asarray(winch.gear_loss)) * np.exp(np.asarray(winch.sheave_friction)))
    for near in range(start, last):
        ends = {near: pulling if near == start else 1.0, near + 1: -1.0}
        sag = {depth: bend / segments} if weighs else {}
        links.append((segments * at.spring, segments * at.damping, ends | sag))
    if present(rope.hysteresis):  # along the whole rope; twice its slope where the strain turns back
        rubbing = 2 * rope.hysteresis / (rope.hysteresis_strain * length)
        links.append((rubbing, 0.0, {start: pulling, last: -1.0} | ({depth: bend} if weighs else {})))
    return _assembled(masses, links)


def _assembled(masses: list[Any], links: list[tuple[Any, Any, dict[int, Any]]]) -> Chain:
    """The chain of masses in kg and links: spring rate in N/m, damping in N s/m, place of a mass → coefficient."""
    values = [*masses, *(value for *pair, ends in links for value in (*pair, *ends.values()))]
    shape, n = np.broadcast_shapes(*map(np.shape, values)), len(masses)
    roots = [np.sqrt(np.asarray(mass, float)) for mass in masses]
    springs, dampers = np.zeros((*shape, n, len(links))), np.zeros((*shape, n, len(links)))
    for column, (spring, damper, ends) in enumerate(links):
        for place, coefficient in ends.items():
            springs[..., place, column] = np.sqrt(np.asarray(spring, float)) * coefficient / roots[place]
            dampers[..., place, column] = np.sqrt(np.asarray(damper, float)) * coefficient / roots[place]
    return Chain(dampers @ np.swapaxes(dampers, -1, -2), springs)


def side_rate(side: Side, vehicle: Vehicle, track: Track, tensions: tuple[float, ...], rate: Rate) -> Any:
    """Largest rate in rad/s of one side's chain at some tensions in N, with its rope at its shortest and its longest.

    By `pole_rate` or `leapfrog_rate`; infinite where a number overflows; an array if numbers are arrays.
    """
    with np.errstate(all="ignore"):
        rates = [rate(chain_of(side, vehicle, track, at)) for at in _tangents(side.rope, track, tensions)]
        return np.max(np.broadcast_arrays(*rates), axis=0)


def _tangents(rope: RopeLaw, track: Track, tensions: tuple[float, ...]) -> Iterator[RopeTangent]:
    """The rope at rest at its shortest and its longest; at all tensions, unless they make no difference."""
    is_massive = not is_kelvin_voigt(rope)
    for length in map(np.float64, (track.rope_offset, track.length + track.rope_offset)):
        for tension in tensions if is_massive or present(rope.submerged_weight) else tensions[:1]:
            if is_massive:
                spring, damping = rope.tangent(tension, float(length))
                yield RopeTangent(length, tension, spring, abs(damping))
            else:
                law = kelvin_voigt(rope)
                yield RopeTangent(length, tension, stiffness(length, law), viscosity(law))


def swing_rate(rope: Rope, winch: Winch, track: Track) -> Any:
    """Largest rate in rad/s at which the shortest massless Kelvin–Voigt rope and its drum oscillate or settle.

    For the exponential integrators, which solve both exactly: the greater of the natural frequency and the half of the
    damping over the mass. An array if numbers of rope or winch are arrays.
    """
    with np.errstate(all="ignore"):
        mobility = base_radius(winch) ** 2 / np.asarray(total_inertia(winch), float)
        natural = np.sqrt(mobility * stiffness(track.rope_offset, rope))
        return np.maximum(natural, mobility * viscosity(rope) / 2)


def bristle_swing_rate(vehicle: Vehicle) -> Any:
    """The `leapfrog_rate` in rad/s of a vehicle on the bristles of its rail; may be an array."""
    with np.errstate(all="ignore"):
        mass = np.asarray(inertia(vehicle), float)
        settling, square = vehicle.bristle_damping / mass / 2, vehicle.bristle_stiffness / mass
        return np.where(square > 0, settling + np.sqrt(settling**2 + square), 0.0)


@lru_cache(maxsize=1024)
def fastest_rate(rope: RopeLaw, winch: Winch, track: Track, tensions: tuple[float, ...]) -> float:
    """Largest rate in rad/s at which a massless rope of any law and its drum oscillate or settle, at tensions in N.

    The largest magnitude of an eigenvalue of s'' = −mobility (spring s + damping s'), for the longest and the shortest
    rope; NaN if the law does not reach a tension, or has no spring rate there.
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


RELIEF: Mapping[str, Mapping[str, float]] = {
    "rope": {"modulus": 0.5, "damping": 0.5, "loss_factor": 0.5, "hysteresis": 0.5, "mass_per_length": 2.0},
    "winch": {
        "inertia": 2.0,
        "rotor_inertia": 2.0,
        "gear_stiffness": 0.5,
        "gear_damping": 0.5,
        "viscous_friction": 0.5,
    },
    "vehicle": {"mass": 2.0, "bristle_stiffness": 0.5, "bristle_damping": 0.5},
}
"""Part of a plant → its numbers that may make it stiff → a factor that makes it less so."""


def stiff_keys(plant: Plant, parts: tuple[str, ...], rate: Callable[[Plant], float]) -> dict[str, float]:
    """Keys and values of the numbers that make a plant stiff: those whose relief by half lowers its rate the most.

    Only numbers of these parts, such as ``rope_1``; those that have their default are left out where others have not.
    """
    values, usual, lowered = leaves(plant, "plant."), leaves(Plant(), "plant."), dict[str, float]()
    for part in parts:
        for name, factor in RELIEF[part.partition("_")[0]].items():
            key = f"plant.{part}.{name}"
            if values.get(key) and math.isfinite(values[key] * factor):
                lowered[key] = rate(with_leaves(plant, {key: values[key] * factor}, "plant."))
    lowest = min(lowered.values(), default=math.inf)
    limiting = {key: values[key] for key, value in lowered.items() if value <= lowest * 1.001}
    return {key: value for key, value in limiting.items() if value != usual.get(key)} or limiting
