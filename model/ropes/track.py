"""The rail between the two winches, and the lengths of rope it leaves (A1)."""

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar, maximum


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
