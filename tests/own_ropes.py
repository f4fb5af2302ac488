"""Ropes as a user writes them: not registered, stiffer the more they are stretched."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.ropes import Rope, RopeLaw
from dualwinch.model.scalar import Scalar, absolute, exp, sqrt


@dataclass(frozen=True)
class Stiffening(RopeLaw):
    """A fibre rope: E A grows with the strain."""

    soft: Annotated[float, at.Gt(0), Quantity("N", "tension over strain of the unstretched rope")] = 4e6
    growth: Annotated[float, at.Ge(0), Quantity("N", "its growth over the strain"), Mark.OFF_AT_ZERO] = 8e9
    damping: Annotated[float, at.Ge(0), Quantity("N s/m", "axial damping")] = 1000.0

    kind: ClassVar = "stiffening"
    label: ClassVar = "fibre rope"
    colour: ClassVar = "tab:brown"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        strain = stretch / length
        return (self.soft + self.growth * absolute(strain)) * strain + self.damping * stretch_rate


@dataclass(frozen=True)
class Bedding(RopeLaw):
    """A rope whose strands bed in: hardly any tension at first, and its stretch is not proportional to its length."""

    scale: Annotated[float, at.Gt(0), Quantity("N", "tension of the bedding")] = 500.0
    ends: Annotated[float, at.Ge(0), Quantity("m", "elasticity of the ends, as a length of rope")] = 2.0

    kind: ClassVar = "bedding"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return self.scale * (exp(3e3 * stretch / (length + self.ends)) - 1) + 500 * stretch_rate


@dataclass(frozen=True)
class Root(RopeLaw):
    """A rope that gets softer, by a root that a loose rope's stretch has not."""

    strength: Annotated[float, at.Gt(0), Quantity("N", "tension at a strain of 1")] = 5e4

    kind: ClassVar = "root"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return self.strength * sqrt(stretch / length) + 1000 * stretch_rate


@dataclass(frozen=True)
class Fading(Rope):
    """A built-in part, changed: this rope lets a tenth go."""

    kind: ClassVar = "fading"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return 0.9 * super().tension(stretch, stretch_rate, length)
