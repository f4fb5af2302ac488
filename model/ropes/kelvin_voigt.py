"""Wire rope: a Kelvin–Voigt element, spring and damper side by side (paper Section 2.2)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.ropes.rope_law import RopeLaw
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Rope(RopeLaw):
    """One wire rope."""

    area: Annotated[float, at.Gt(0), Quantity("m^2", "cross-section of the rope", "Table 1")] = 4.52e-4
    modulus: Annotated[float, at.Gt(0), Quantity("Pa", "axial elastic modulus", "Table 1")] = 80e9
    damping: Annotated[float, at.Ge(0), Quantity("N s/m", "axial damping", "Table 1"), Mark.OFF_AT_ZERO] = 1000.0

    kind: ClassVar = "kelvin-voigt"
    label: ClassVar = "Kelvin–Voigt rope"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        """Tension in N: spring plus damper."""
        return stiffness(length, self) * stretch + self.damping * stretch_rate

    def pull(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar, closeness: Scalar) -> Scalar:  # noqa: ARG002
        """The same without a division."""
        return self.modulus * self.area * closeness * stretch + self.damping * stretch_rate

    def resting_stretch(self, tension: Scalar, length: Scalar) -> Scalar:
        """Stretch in m at rest."""
        return tension / stiffness(length, self)

    def steady_stretch(self, tension: Scalar, length: Scalar, length_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch in m, and its slope over the length: the strain, F / (E A + c dlength/dt)."""
        strain = tension / (self.modulus * self.area + self.damping * length_rate)
        return strain * length, strain

    def tangent(self, tension: Scalar, length: Scalar) -> tuple[Scalar, Scalar]:  # noqa: ARG002
        """Spring rate in N/m and damping in N s/m, at all tensions the same."""
        return stiffness(length, self), self.damping


def stiffness(length: Scalar, rope: Rope) -> Scalar:
    """Spring rate in N/m of a rope of a length in m: E A / length."""
    return rope.modulus * rope.area / length


def compliance(length: Scalar, rope: Rope) -> Scalar:
    """Stretch in m under a tension of 1 N of a rope of a length in m: length / (E A)."""
    return length / (rope.modulus * rope.area)


def is_kelvin_voigt(rope: RopeLaw) -> bool:
    """Whether a rope's law is that of `Rope`; one that is made of it may write another tension."""
    return isinstance(rope, Rope) and type(rope).tension is Rope.tension


def kelvin_voigt(rope: RopeLaw) -> Rope:
    """A rope, for what is made for Kelvin–Voigt ropes alone.

    Raises:
        ConfigurationError: it is of another law.
    """
    if isinstance(rope, Rope) and is_kelvin_voigt(rope):
        return rope
    raise ConfigurationError(f"rope '{rope.kind}': must be a Kelvin–Voigt rope here, such as its tangent_rope")


def tangent_rope(rope: RopeLaw, tension: Scalar, length: Scalar) -> Rope:
    """The Kelvin–Voigt rope that is like a rope about rest under a tension in N at a length in m.

    Its spring rate and damping are the law's there; its cross-section is the default one, for what counts is E A.
    """
    if type(rope) is Rope:
        return rope
    if isinstance(rope, Rope) and is_kelvin_voigt(rope):
        return Rope(rope.area, rope.modulus, rope.damping)
    spring, damping = rope.tangent(tension, length)
    return Rope(modulus=spring * length / Rope.area, damping=damping)
