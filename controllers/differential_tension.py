"""Differential-tension coordination: one force command becomes two tension commands (paper Section 3.2, E11)."""

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from model.quantity import Quantity
from model.scalar import Scalar, clip


@dataclass(frozen=True)
class Coordination:
    """Preload and limits of the two tensions; 2 tension_min < preload < 2 tension_max."""

    preload: Annotated[float, at.Gt(0), Quantity("N", "sum of both tension commands", "paper Section 4.1")] = 2000.0
    tension_min: Annotated[float, at.Gt(0), Quantity("N", "lower force limit of a winch", "Table 1")] = 200.0
    tension_max: Annotated[float, at.Gt(0), Quantity("N", "upper force limit of a winch", "Table 1")] = 6000.0


def force_limit(coordination: Coordination) -> Scalar:
    """Largest net force in N the two ropes can give: tension_max − tension_min (paper Section 3.1.1)."""
    return coordination.tension_max - coordination.tension_min


def tension_commands(u_sat: Scalar, coordination: Coordination) -> tuple[Scalar, Scalar]:
    """Commands F1_cmd and F2_cmd in N; what one rope cannot give, the other takes over (paper Section 3.2).

    Args:
        u_sat: net force in N, within ± `force_limit`.
        coordination: preload and limits.
    """
    lower, upper = coordination.tension_min, coordination.tension_max
    wanted_1 = (coordination.preload + u_sat) / 2
    wanted_2 = (coordination.preload - u_sat) / 2
    excess_1 = clip(wanted_1, lower, upper) - wanted_1
    excess_2 = clip(wanted_2, lower, upper) - wanted_2
    return clip(wanted_1 + excess_2, lower, upper), clip(wanted_2 + excess_1, lower, upper)
