"""Preload and limits of the two rope tensions, the same for every law and coordination."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.model.linear.operating_point import PRELOAD, TENSION_MAX, TENSION_MIN
from dualwinch.model.quantities.quantity import NonNegative, Positive, Quantity, Rule, Tunable
from dualwinch.model.scalar import Scalar, both, clip


@dataclass(frozen=True)
class Limits:
    """Preload and limits of the two tensions, 2 tension_min < preload < 2 command_max."""

    preload: Annotated[
        Positive,
        Quantity("N", "sum of both tension commands", "paper Section 4.1"),
        Tunable(800, 10000, log=False, of=("tension_min", "tension_max")),
    ] = PRELOAD
    tension_min: Annotated[Positive, Quantity("N", "lower force limit of a winch", "Table 1")] = TENSION_MIN
    tension_max: Annotated[Positive, Quantity("N", "upper force limit of a winch", "Table 1")] = TENSION_MAX
    reserve: Annotated[
        NonNegative,
        Quantity("N", "margin of tension commands below tension_max, for overshoot and noise", "assumption"),
        Tunable(0, 700, log=False, standard=False, of="tension_max"),
    ] = 0.0

    rules: ClassVar = (
        Rule(
            ("tension_min", "tension_max"),
            lambda limits: limits.tension_min < limits.tension_max,
            lambda limits, table: f"must be < {table}tension_max = {limits.tension_max:g} N",
        ),
        Rule(
            ("reserve", "tension_min", "tension_max"),
            lambda limits: limits.tension_min < limits.command_max,
            lambda limits, _: f"must be < {limits.tension_max - limits.tension_min:g} N (tension_max - tension_min)",
        ),
        Rule(
            ("preload", "tension_min", "tension_max", "reserve"),
            lambda limits: both(2 * limits.tension_min < limits.preload, limits.preload < 2 * limits.command_max),
            lambda limits, _: (
                f"must be > {2 * limits.tension_min:g} and < {2 * limits.command_max:g} N "
                "(twice tension_min and twice tension_max - reserve)"
            ),
        ),
    )

    @property
    def taut(self) -> Scalar:
        """Tension in N from which a rope counts as taut: half of tension_min."""
        return self.tension_min / 2

    @property
    def command_max(self) -> Scalar:
        """Largest tension command in N: tension_max − reserve."""
        return self.tension_max - self.reserve

    @property
    def force(self) -> Scalar:
        """Largest net force command in N: command_max − tension_min (paper Section 3.1.1)."""
        return self.command_max - self.tension_min

    @property
    def strength(self) -> Scalar:
        """Largest net force in N of the two ropes: tension_max − tension_min."""
        return self.tension_max - self.tension_min

    def clipped(self, force: Scalar) -> Scalar:
        """A net force in N limited to ± `force`."""
        return clip(force, -self.force, self.force)


def within_limits(wanted_1: Scalar, wanted_2: Scalar, limits: Limits) -> tuple[Scalar, Scalar]:
    """Commands F1_cmd and F2_cmd in N; the excess of one rope over its limits goes to the other (Section 3.2, E11)."""
    lower, upper = limits.tension_min, limits.command_max
    excess_1 = clip(wanted_1, lower, upper) - wanted_1
    excess_2 = clip(wanted_2, lower, upper) - wanted_2
    return clip(wanted_1 + excess_2, lower, upper), clip(wanted_2 + excess_1, lower, upper)
