"""Wire rope: a Kelvin–Voigt element that pulls and never pushes (paper Section 2.2)."""

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, maximum, minimum, where


@dataclass(frozen=True)
class Rope:
    """One wire rope."""

    area: Annotated[float, at.Gt(0), Quantity("m^2", "cross-section of the rope", "Table 1")] = 4.52e-4
    modulus: Annotated[float, at.Gt(0), Quantity("Pa", "axial elastic modulus", "Table 1")] = 80e9
    damping: Annotated[float, at.Ge(0), Quantity("N s/m", "axial damping", "Table 1"), Mark.OFF_AT_ZERO] = 1000.0


@dataclass(frozen=True)
class Track:
    """The rail between the two winches."""

    length: Annotated[float, at.Gt(0), Quantity("m", "length of the rail, L_0 in the paper", "Table 1")] = 50.0
    rope_offset: Annotated[
        float, at.Ge(0.05), Quantity("m", "rope between winch and vehicle at the rail's end", "A1")
    ] = 0.5


SHORTEST_ROPE = 0.05
"""Guard on the rope length in m: EA/length is infinite at zero (A1)."""


def rope_lengths(x: Scalar, track: Track) -> tuple[Scalar, Scalar]:
    """Lengths in m of rope 1 (full at x = 0) and rope 2 (shortest at x = 0) with the vehicle at x in m (A1)."""
    length_1 = maximum(track.length - x + track.rope_offset, SHORTEST_ROPE)
    length_2 = maximum(x + track.rope_offset, SHORTEST_ROPE)
    return length_1, length_2


def stiffness(length: Scalar, rope: Rope) -> Scalar:
    """Spring rate in N/m of a rope of a length in m: E A / length."""
    return rope.modulus * rope.area / length


def compliance(length: Scalar, rope: Rope) -> Scalar:
    """Stretch in m under a tension of 1 N of a rope of a length in m: length / (E A)."""
    return length / (rope.modulus * rope.area)


def tension(stretch: Scalar, stretch_rate: Scalar, length: Scalar, rope: Rope, *, slack: bool = True) -> Scalar:
    """Tension in N: spring plus damper, zero while the rope is slack (paper Section 2.2, A2).

    Args:
        stretch: elongation in m; negative while the rope hangs loose.
        stretch_rate: its rate in m/s.
        length: rope length in m.
        rope: the rope.
        slack: whether the *total* force is clamped at zero; ``False`` gives the paper's two-sided rope.
    """
    return spring_tension(stretch, stretch_rate, stiffness(length, rope), rope, slack=slack)


def spring_tension(stretch: Scalar, stretch_rate: Scalar, spring: Scalar, rope: Rope, *, slack: bool = True) -> Scalar:
    """`tension` from the spring rate in N/m."""
    pull = spring * stretch + rope.damping * stretch_rate
    if not slack:
        return pull
    return where(minimum(stretch, pull) > 0, pull, 0.0)
