"""A drum on its rope: the mass that moves, the wave impedance that damps it, and the frequency of the spans."""

import math

from dualwinch.model.heavy_ropes import (
    end_mass,
    ernst_factor,
    rope_on_drum,
    span_of,
    transverse_mass,
    wire_rope_mass,
)
from dualwinch.model.plant import Side
from dualwinch.model.ropes import RopeLaw, Track, kelvin_voigt, stiffness
from dualwinch.model.scalar import Scalar, present, sqrt
from dualwinch.model.winch import total_inertia


def moving_mass(side: Side, length: Scalar, track: Track) -> Scalar:
    """Mass in kg at a drum's rim that moves at the resonance of the drum on its rope of a length in m.

    ``J/R² + wound rope + 4/pi² mu length``: the part of the free rope is that of its first mode, fixed at the vehicle.
    """
    rope, winch = side.rope, side.winch
    wound = rope_on_drum(rope, length, track) - end_mass(rope, length)
    return total_inertia(winch) / winch.drum_radius**2 + wound + 4 / math.pi**2 * rope.mass_per_length * length


def tangent_rigidity(rope: RopeLaw, tension: Scalar, length: Scalar, track: Track) -> Scalar:
    """Tangent E A in N of a rope under a tension in N, with the sag of its spans by Ernst's factor."""
    rigidity = rope.tangent(tension, length)[0] * length
    if not present(rope.submerged_weight):
        return rigidity
    return rigidity * ernst_factor(rope.submerged_weight, span_of(length, track), tension, rigidity)


def wave_impedance(rope: RopeLaw, tension: Scalar, length: Scalar) -> Scalar:
    """``sqrt(E A mu)`` in N s/m of a taut rope under a tension in N: a drum with this damping reflects no wave.

    A rope modelled without mass has that of a wire rope of its diameter.
    """
    mass = rope.mass_per_length if present(rope.mass_per_length) else wire_rope_mass(rope.diameter)
    return sqrt(rope.tangent(tension, length)[0] * length * mass)


def span_frequency(rope: RopeLaw, tension: Scalar, length: Scalar, track: Track) -> Scalar:
    """First transverse frequency in rad/s of a rope's spans under a tension in N: pi/s sqrt(T/m)."""
    return math.pi / span_of(length, track) * sqrt(tension / transverse_mass(rope))


def drum_frequency(side: Side, tension: Scalar, length: Scalar, track: Track) -> Scalar:
    """Angular frequency in rad/s of a drum on its taut rope under a tension in N."""
    return sqrt(side.rope.tangent(tension, length)[0] / moving_mass(side, length, track))


def drum_impedance(side: Side, length: Scalar, track: Track) -> Scalar:
    """``sqrt(k m)`` in N s/m of a drum on a taut rope: the amplitude of its tension over that of its speed."""
    return sqrt(stiffness(length, kelvin_voigt(side.rope)) * moving_mass(side, length, track))
