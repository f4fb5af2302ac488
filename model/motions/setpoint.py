"""Where the vehicle should be, and motions put together of pieces."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar, where


@dataclass(frozen=True)
class Setpoint:
    """Where the vehicle should be."""

    x: Annotated[Scalar, Quantity("m", "reference position")]
    v: Annotated[Scalar, Quantity("m/s", "reference speed")]
    a: Annotated[Scalar, Quantity("m/s^2", "reference acceleration")]

    def ahead(self, by: float) -> "Setpoint":
        """Where it should be a time in s later, as far as that is known: it goes on with its acceleration.

        A setpoint with a preview (`model.motions.preview.Previewed`) knows better.
        """
        return later(self, by)


def later(setpoint: Setpoint, by: Scalar) -> Setpoint:
    """Where it should be a short time in s later, the acceleration being what it is."""
    return Setpoint(setpoint.x + by * (setpoint.v + by / 2 * setpoint.a), setpoint.v + by * setpoint.a, setpoint.a)


def piece_at(t: Scalar, pieces: Sequence[tuple[Scalar, Setpoint]], last: Setpoint) -> Setpoint:
    """The piece whose end is the first not before t, or the last one, which has no end."""
    found = last
    for end, piece in reversed(pieces):
        found = Setpoint(
            x=where(t <= end, piece.x, found.x),
            v=where(t <= end, piece.v, found.v),
            a=where(t <= end, piece.a, found.a),
        )
    return found
