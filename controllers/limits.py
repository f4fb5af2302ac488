"""What every coordination of the two winches shares: preload, limits, and what it says."""

from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at

from dualwinch.model.quantity import Quantity, Tunable
from dualwinch.model.scalar import Scalar, clip
from dualwinch.model.steady_cruise import PRELOAD, TENSION_MAX, TENSION_MIN


@dataclass(frozen=True)
class Coordination:
    """Preload and limits of the two tensions, 2 tension_min < preload < 2 command_max; and how the winches share."""

    preload: Annotated[
        float,
        at.Gt(0),
        Quantity("N", "sum of both tension commands", "paper Section 4.1"),
        Tunable(800, 10000, log=False),
    ] = PRELOAD
    tension_min: Annotated[float, at.Gt(0), Quantity("N", "lower force limit of a winch", "Table 1")] = TENSION_MIN
    tension_max: Annotated[float, at.Gt(0), Quantity("N", "upper force limit of a winch", "Table 1")] = TENSION_MAX
    reserve: Annotated[
        float,
        at.Ge(0),
        Quantity("N", "distance that tension commands keep from tension_max, for overshoot and noise", "assumption"),
        Tunable(0, 700, log=False, standard=False),
    ] = 0.0
    kind: Annotated[
        Literal["differential-tension", "master-slave", "force-position"],
        Quantity("", "how the winches share the force; the last two are what the paper argues against", "paper 1.1"),
    ] = "differential-tension"

    @property
    def command_max(self) -> Scalar:
        """Largest tension in N that is asked of a winch: tension_max − reserve."""
        return self.tension_max - self.reserve


@dataclass(frozen=True)
class CoordinationOutput:
    """Tension commands in N, motor torques in N m, and whether a torque is at its limit."""

    F1_cmd: Scalar
    F2_cmd: Scalar
    tau1: Scalar
    tau2: Scalar
    torque_saturated: Scalar


def force_limit(coordination: Coordination) -> Scalar:
    """Largest net force in N that is asked of the two ropes: command_max − tension_min (paper Section 3.1.1)."""
    return coordination.command_max - coordination.tension_min


def strength(coordination: Coordination) -> Scalar:
    """Largest net force in N the two ropes can give: tension_max − tension_min."""
    return coordination.tension_max - coordination.tension_min


def within_limits(wanted_1: Scalar, wanted_2: Scalar, coordination: Coordination) -> tuple[Scalar, Scalar]:
    """Commands F1_cmd and F2_cmd in N; what one rope cannot give, the other takes over (paper Section 3.2, E11)."""
    lower, upper = coordination.tension_min, coordination.command_max
    excess_1 = clip(wanted_1, lower, upper) - wanted_1
    excess_2 = clip(wanted_2, lower, upper) - wanted_2
    return clip(wanted_1 + excess_2, lower, upper), clip(wanted_2 + excess_1, lower, upper)
