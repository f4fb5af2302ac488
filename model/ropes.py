"""Ropes: tension laws, the Kelvin–Voigt rope of the paper (Section 2.2), creep, and the ropes' lengths.

A custom law is a frozen dataclass of its parameters with one method, `RopeLaw.tension`. The other methods follow from
that expression: spring rate and damping are its derivatives, the stretch at a tension its solution by Newton's method.
A law with closed forms may override those methods.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import annotated_types as at
import casadi as ca

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, Registry
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Rule, UnitInterval
from dualwinch.model.quantities.steps import over_symbols
from dualwinch.model.quantities.tree import alike, numbers, with_leaves
from dualwinch.model.scalar import Scalar, both, either, exp, log, maximum, minimum, present, sqrt, where


@dataclass(frozen=True)
class Track:
    """The rail between the two winches."""

    length: Annotated[Positive, Quantity("m", "length of the rail, L_0 in the paper", "Table 1")] = 50.0
    roller_spacing: Annotated[
        NonNegative,
        Quantity("m", "spacing of the rollers that carry the ropes; 0: one span", "A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    roller_friction: Annotated[
        NonNegative, Quantity("1", "friction coefficient of the rollers", "0.05 to 0.2, A14"), Mark.OFF_AT_ZERO
    ] = 0.0
    tilt: Annotated[
        float,
        at.Ge(-0.1),
        at.Le(0.1),
        Quantity("rad", "slope of the rail, positive where it rises towards winch 1", "A14"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    waviness: Annotated[
        NonNegative,
        at.Le(0.1),
        Quantity("rad", "amplitude of the slope of a wavy rail, in addition to tilt", "A14"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    wavelength: Annotated[
        Positive, Quantity("m", "length of the rail's waves", "A14"), Mark.UNKNOWN, Mark.SHAPE_PARAMETER
    ] = 10.0
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


NEW = 0.0
"""Time in s at which a rope has not crept: the start of a run."""


@dataclass(frozen=True)
class Creep:
    """Permanent elongation of one rope, ``elongation (1 - exp(-t/time))``."""

    elongation: Annotated[
        UnitInterval,
        Quantity("m", "final permanent elongation of the rope", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.UNKNOWN,
    ] = 0.0
    time: Annotated[
        Positive,
        Quantity("s", "time constant of the permanent elongation", "assumption"),
        Mark.UNKNOWN,
        Mark.SHAPE_PARAMETER,
    ] = 60.0


def crept(t: Scalar, creep: Creep) -> tuple[Scalar, Scalar]:
    """Permanent elongation in m at the time t in s since the beginning of the run, and its rate in m/s."""
    remainder = creep.elongation * exp(-t / creep.time)
    return creep.elongation - remainder, remainder / creep.time


@dataclass(frozen=True, kw_only=True)
class RopeLaw(Part):
    """Tension law of a rope: a frozen dataclass of its parameters, in addition to the mass and sag of every rope.

    There are two ropes: parameters are addressed by the field that holds the rope, ``plant.rope_1.k``. The effects of
    mass, weight and water, the same for all laws, are in `model.heavy_ropes`; all are zero unless given (A14).
    """

    mass_per_length: Annotated[
        NonNegative,
        Quantity("kg/m", "mass of the rope; 0: no waves along the rope", "EN 12385-4: 2.36 for 24 mm, A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    segments: Annotated[
        int,
        at.Ge(1),
        at.Le(16),
        Quantity("1", "equal segments into which a rope with mass is lumped", "model.heavy_ropes"),
        Mark.SHAPES_CODE,
    ] = 2
    shortest_mass: Annotated[
        NonNegative,
        Quantity("m", "a shorter rope has the mass of one of this length (mass scaling)", "model.heavy_ropes"),
        Mark.SHAPE_PARAMETER,
    ] = 6.0
    spare_length: Annotated[
        NonNegative,
        Quantity("m", "rope on the drum with the vehicle at the far end of the rail", "A14"),
        Mark.OFF_AT_ZERO,
    ] = 0.0
    submerged_weight: Annotated[
        NonNegative,
        Quantity("N/m", "weight of the rope in water; 0: the rope does not sag", "20.2 for 24 mm, A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    added_mass_per_length: Annotated[
        NonNegative,
        Quantity("kg/m", "added mass of the water in transverse motion", "0.6 for 24 mm, A14"),
        Mark.OFF_AT_ZERO,
    ] = 0.0
    diameter: Annotated[Positive, Quantity("m", "diameter of the rope", "from area, Table 1")] = 0.024
    skin_friction: Annotated[
        NonNegative, Quantity("1", "drag coefficient along the rope, on its skin", "0.01, A14"), Mark.OFF_AT_ZERO
    ] = 0.0
    cross_drag: Annotated[
        NonNegative, Quantity("1", "drag coefficient across the rope", "1.2, A14"), Mark.OFF_AT_ZERO
    ] = 0.0
    hysteresis: Annotated[
        NonNegative,
        Quantity("N", "largest friction between the rope's wires (Dahl); 0: none", "up to 14, A14"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    hysteresis_strain: Annotated[
        Positive,
        Quantity("1", "strain over which that friction changes by the share 1 − 1/e", "4e-6, A14"),
        Mark.SHAPE_PARAMETER,
    ] = 4e-6

    def __init_subclass__(cls, **options: Any) -> None:
        """Reset the methods derived from the tension in a subclass that overrides it."""
        super().__init_subclass__(**options)
        if "tension" in vars(cls):
            for name in DERIVED.difference(vars(cls)):
                setattr(cls, name, getattr(RopeLaw, name))

    @classmethod
    def table(cls) -> str:
        """No table of its own: the parameters stand in that of the field that holds the rope."""
        return ""

    @abstractmethod
    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        """Tension in N, over floats or CasADi symbols; it increases with the stretch.

        The plant sets it to zero where a rope is slack or would push; a law need not.

        Args:
            stretch: elongation in m; negative while the rope is slack.
            stretch_rate: its rate in m/s.
            length: length of the unstretched rope in m.
        """

    def pull(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar, inverse_length: Scalar) -> Scalar:  # noqa: ARG002
        """`tension`, with 1/length in 1/m given as ``inverse_length``."""
        return self.tension(stretch, stretch_rate, length)

    def resting_stretch(self, tension: Scalar, length: Scalar) -> Scalar:
        """Stretch in m at rest under a tension in N, of a rope of a length in m."""
        (stretch,) = _called(_resting(alike(self)), self, tension, length)
        return stretch

    def steady_stretch(self, tension: Scalar, length: Scalar, length_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch in m at constant tension while the length of the rope changes at a constant rate.

        Exact at rest, and for all laws whose stretch at a tension is proportional to the length. For others the rate
        of change of the slope is neglected.

        Args:
            tension: in N.
            length: in m.
            length_rate: in m/s.

        Returns:
            The stretch, and its slope over the length, in m/m.
        """
        stretch, slope = _called(_steady(alike(self)), self, tension, length, length_rate)
        return stretch, slope

    def tangent(self, tension: Scalar, length: Scalar) -> tuple[Scalar, Scalar]:
        """Spring rate in N/m and damping in N s/m, linearised at rest under a tension in N, for a length in m."""
        stretch = self.resting_stretch(tension, length)
        _, spring, damping, _ = _called(_slopes(alike(self)), self, stretch, 0.0, length)
        return spring, damping


DERIVED = frozenset({"pull", "resting_stretch", "steady_stretch", "tangent"})
"""Methods derived from `RopeLaw.tension`."""

NEWTON_STEPS = 30
"""Newton or bisection steps for the stretch at rest."""

CORRECTIONS = 8
"""Newton steps from there to the stretch of a rope whose length changes."""

STRAINS = (-40.0, -7.0, 3.0)
"""Natural logarithms of the lower bound, the initial value and the upper bound of the strain."""

TINY = 1e-60
"""Floor of divisors and arguments of logarithms; its square and slope do not underflow."""


def one_sided(stretch: Scalar, pull: Scalar) -> Scalar:
    """Tension in N from the two-sided force `pull` in N: zero while the rope is slack or would push (A2)."""
    return where(minimum(stretch, pull) > 0, pull, 0.0)


def _called(function: ca.Function, rope: RopeLaw, *values: Scalar) -> list[Scalar]:
    """Outputs of a function for some values and a rope's parameters; floats for floats."""
    outputs = function.call([*values, *numbers(rope).values()])
    return [float(value) if isinstance(value, ca.DM) else value for value in outputs]


@built_once
def _slopes(rope: RopeLaw) -> ca.Function:
    """``(stretch, stretch_rate, length, *numbers) -> tension`` and its slopes over the first three."""
    symbols = {name: ca.SX.sym(name) for name in numbers(rope)}
    inputs = [ca.SX.sym(name) for name in ("stretch", "stretch_rate", "length")]
    with over_symbols(f"{rope.kind}: its tension"):
        tension = ca.SX(with_leaves(rope, symbols).tension(*inputs))
    slopes = [ca.densify(ca.jacobian(tension, variable)) for variable in inputs]
    return ca.Function("tension", [*inputs, *symbols.values()], [ca.densify(tension), *slopes])


@built_once
def _resting(rope: RopeLaw) -> ca.Function:
    """``(tension, length, *numbers) -> stretch`` at rest.

    Newton's method for the logarithm of the strain, exact in one step for a tension that is a power of the stretch,
    safeguarded by bisection of the bracket.
    """
    symbols = [ca.SX.sym(name) for name in numbers(rope)]
    tension, length = ca.SX.sym("tension"), ca.SX.sym("length")
    lower, strain, upper = map(ca.SX, STRAINS)
    for _ in range(NEWTON_STEPS):
        stretch = exp(strain) * length
        pull, spring, *_ = _slopes(rope).call([stretch, 0, length, *symbols])
        lower, upper = where(pull < tension, strain, lower), where(pull < tension, upper, strain)
        exponent = maximum(stretch * spring, TINY) / maximum(pull, TINY)
        newton = strain + log(maximum(tension, TINY) / maximum(pull, TINY)) / exponent
        inside = both(pull > 0, both(newton >= lower, newton <= upper))
        strain = where(inside, newton, (lower + upper) / 2)
    return ca.Function("resting", [tension, length, *symbols], [exp(strain) * length])


@built_once
def _steady(rope: RopeLaw) -> ca.Function:
    """``(tension, length, length_rate, *numbers) -> (stretch, slope)`` of `RopeLaw.steady_stretch`.

    At constant tension T(s, ds/dt, l), dT = 0 gives ds/dl = −(∂T/∂l)/(∂T/∂s). That rate changes the stretch little:
    Newton's method starts from the stretch at rest.
    """
    symbols = [ca.SX.sym(name) for name in numbers(rope)]
    tension, length, length_rate = (ca.SX.sym(name) for name in ("tension", "length", "length_rate"))
    (stretch,), slope = _resting(rope).call([tension, length, *symbols]), ca.SX(0)
    for _ in range(CORRECTIONS):
        pull, spring, _, by_length = _slopes(rope).call([stretch, slope * length_rate, length, *symbols])
        stretch, slope = stretch + (tension - pull) / spring, -by_length / spring
    return ca.Function("steady", [tension, length, length_rate, *symbols], [stretch, slope])


@dataclass(frozen=True)
class Rope(RopeLaw):
    """One wire rope."""

    area: Annotated[Positive, Quantity("m^2", "area that modulus refers to; their product counts", "Table 1")] = 4.52e-4
    modulus: Annotated[Positive, Quantity("Pa", "axial elastic modulus", "Table 1")] = 80e9
    damping: Annotated[NonNegative, Quantity("N s/m", "axial damping", "Table 1"), Mark.OFF_AT_ZERO] = 1000.0
    loss_factor: Annotated[
        NonNegative,
        Quantity("1", "loss factor of the rope at its first mode, in addition to damping", "0.02, A14"),
        Mark.OFF_AT_ZERO,
    ] = 0.0

    rules: ClassVar = (
        Rule(
            ("loss_factor", "mass_per_length"),
            lambda rope: either(rope.loss_factor == 0, rope.mass_per_length > 0),
            lambda _, table: f"must be 0 without {table}mass_per_length > 0: it needs the rope's first mode",
        ),
    )

    kind: ClassVar = "kelvin-voigt"
    label: ClassVar = "Kelvin–Voigt rope"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        """Tension in N: spring plus damper."""
        return stiffness(length, self) * stretch + viscosity(self) * stretch_rate

    def pull(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar, inverse_length: Scalar) -> Scalar:  # noqa: ARG002
        """Tension in N without a division."""
        return self.modulus * self.area * inverse_length * stretch + viscosity(self) * stretch_rate

    def resting_stretch(self, tension: Scalar, length: Scalar) -> Scalar:
        """Stretch in m at rest."""
        return tension / stiffness(length, self)

    def steady_stretch(self, tension: Scalar, length: Scalar, length_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Stretch in m, and its slope with respect to the length: the strain, F / (E A + c dlength/dt)."""
        strain = tension / (self.modulus * self.area + viscosity(self) * length_rate)
        return strain * length, strain

    def tangent(self, tension: Scalar, length: Scalar) -> tuple[Scalar, Scalar]:  # noqa: ARG002
        """Spring rate in N/m and damping in N s/m, the same at all tensions."""
        return stiffness(length, self), viscosity(self)


def stiffness(length: Scalar, rope: Rope) -> Scalar:
    """Spring rate in N/m of a rope of a length in m: E A / length."""
    return rope.modulus * rope.area / length


def viscosity(rope: Rope) -> Scalar:
    """Damping in N s/m of a rope: ``damping`` plus that of the loss factor at the first longitudinal mode.

    A loss factor eta is the damping eta k/omega; with k = E A/L and the first mode of a fixed–free bar,
    omega = pi/2 sqrt(E A/mu)/L, that is 2/pi eta sqrt(E A mu) for every length.
    """
    if not present(rope.loss_factor):
        return rope.damping
    return rope.damping + 2 / math.pi * rope.loss_factor * sqrt(rope.modulus * rope.area * rope.mass_per_length)


def compliance(length: Scalar, rope: Rope) -> Scalar:
    """Compliance in m/N of a rope of a length in m: length / (E A)."""
    return length / (rope.modulus * rope.area)


def is_kelvin_voigt(rope: RopeLaw) -> bool:
    """Whether a rope has the tension of `Rope`, which subclasses may override."""
    return isinstance(rope, Rope) and type(rope).tension is Rope.tension


def kelvin_voigt(rope: RopeLaw) -> Rope:
    """The rope, checked to be a Kelvin–Voigt rope.

    Raises:
        ConfigurationError: it has another law.
    """
    if isinstance(rope, Rope) and is_kelvin_voigt(rope):
        return rope
    raise ConfigurationError(f"rope '{rope.kind}': must be a Kelvin–Voigt rope here, such as its tangent_rope")


def tangent_rope(rope: RopeLaw, tension: Scalar, length: Scalar) -> Rope:
    """The Kelvin–Voigt rope tangent to a rope's law at rest under a tension in N at a length in m.

    It has the law's spring rate and damping there, and the default cross-section: only E A matters.
    """
    if type(rope) is Rope:
        return rope
    if isinstance(rope, Rope) and is_kelvin_voigt(rope):
        return Rope(rope.area, rope.modulus, rope.damping)
    spring, damping = rope.tangent(tension, length)
    return Rope(modulus=spring * length / Rope.area, damping=damping)


ROPES: Registry[RopeLaw] = Registry("rope", Rope)
"""Every rope law by its kind."""
