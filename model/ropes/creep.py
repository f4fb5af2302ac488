"""Creep of a rope: wires settle under load, and the rope stays a little longer than it was, whatever its law."""

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, exp

NEW = 0.0
"""Time in s at which a rope has not crept yet: the beginning of a run."""


@dataclass(frozen=True)
class Creep:
    """Permanent elongation of one rope, ``elongation (1 - exp(-t/time))``."""

    elongation: Annotated[
        float,
        at.Ge(0),
        at.Le(1),
        Quantity("m", "permanent elongation of the rope in the long run", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    time: Annotated[
        float,
        at.Gt(0),
        Quantity("s", "time constant of the permanent elongation", "assumption"),
        Mark.UNKNOWN,
        Mark.COURSE,
    ] = 60.0


def crept(t: Scalar, creep: Creep) -> tuple[Scalar, Scalar]:
    """Permanent elongation in m at the time t in s since the beginning of the run, and its rate in m/s."""
    left = creep.elongation * exp(-t / creep.time)
    return creep.elongation - left, left / creep.time
