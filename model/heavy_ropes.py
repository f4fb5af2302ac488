"""Ropes with mass and weight: longitudinal waves, sag between rollers, drag, hysteresis (assumption A14).

A rope runs from its drum, which has retrieved ``wound`` metres of it, to the vehicle; its chord is longer than the
unstretched rope by ``stretch``. Displacements along the rope are positive where they retrieve it.

**Waves.** The rope is lumped into n equal segments (``segments``): half a segment's mass at either end, one at each of
the n − 1 inner nodes. For every law, a segment's tension is that of the whole rope at n times the segment's stretch.
The first mode of a fixed–free bar, c/4L, has a relative error of (pi/4n)²/6. The mesh moves with the rope, which
neglects mu v² (8 N at 1.8 m/s). Inner nodes of a short rope oscillate too fast to be worth resolving: below
``shortest_mass`` metres the mass is that of this length (mass scaling, as in explicit finite elements).

**Sag.** Each span between two rollers is a parabola of depth d, one transverse mode of the span (Galerkin, with the
shape 4 xi (1 − xi)). Its arc is longer than its chord by the share 8/3 (d/s)², which adds to the strain, and::

    8/15 m d'' = 2/3 w − 16/3 T d/s² − 16/35 · 1/2 rho C D |d'| d'

with the transverse mass m and the weight w per metre and the mean tension T. At rest d = w s²/(8 T), and the tangent
stiffness is Ernst's modulus. One mode suffices while lambda² = (w s)² E A/T³ is below 15 (errors of 1 to 2 % in the
first symmetric frequency); at 100 the error is a sixth (`mode_error`).

**Hysteresis.** Friction between the wires adds ``hysteresis z`` to the tension of the law, where z follows the strain,
in units of ``hysteresis_strain``, by Dahl's model with the limit 1 (`model.friction`). A cycle of strain between ± a
dissipates 4 T (a − d tanh(a/d)) per metre of rope, with the largest force T and the strain d.

References: Irvine, *Cable Structures* (1981), chapters 2 and 3; Ernst, *Der Bauingenieur* 40 (1965).
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

from dualwinch.model.friction import bristle_rate
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, Quantity, vector
from dualwinch.model.ropes import SHORTEST_ROPE, RopeLaw, Track, one_sided
from dualwinch.model.scalar import Scalar, absolute, maximum, minimum, present, sqrt, tanh, where
from dualwinch.model.vehicle import Vehicle


@dataclass(frozen=True)
class Waves:
    """Inner nodes of a rope with mass, from the drum to the vehicle."""

    position: Annotated[Any, Quantity("m", "displacement of an inner node of the rope towards the winch")]
    speed: Annotated[Any, Quantity("m/s", "speed of that node"), Mark.RATE]


@dataclass(frozen=True)
class Sag:
    """Sag of a rope with weight, the same in each of its spans."""

    depth: Annotated[Scalar, Quantity("m", "sag at midspan")]
    rate: Annotated[Scalar, Quantity("m/s", "its rate"), Mark.RATE]


@dataclass(frozen=True)
class Hysteresis:
    """Friction between the wires of a rope."""

    share: Annotated[Scalar, Quantity("1", "friction between the wires over its largest value"), Mark.SETTLES]


@dataclass(frozen=True)
class RopeState:
    """State of a rope; empty without mass, weight and hysteresis."""

    waves: Any = NO_STATE
    sag: Any = NO_STATE
    hysteresis: Any = NO_STATE


MASSLESS = RopeState()
"""State of a rope without mass, weight and hysteresis."""


@dataclass(frozen=True)
class RopeEnds:
    """Motion of the ends of a rope.

    Attributes:
        wound, wound_rate: rope retrieved by the drum in m, and its rate in m/s.
        stretch, stretch_rate: stretch of the chord between drum and vehicle in m, and its rate in m/s.
        length, inverse_length: length of the rope in m, and its reciprocal in 1/m.
    """

    wound: Scalar
    wound_rate: Scalar
    stretch: Scalar
    stretch_rate: Scalar
    length: Scalar
    inverse_length: Scalar


@dataclass(frozen=True)
class RopePull:
    """Tension of a rope in N at the drum, its pull on the vehicle in N, and the rates of its state.

    The segments' tensions, from the drum to the vehicle, differ from these by drag and roller friction.
    """

    at_drum: Scalar
    at_vehicle: Scalar
    segments: tuple[Scalar, ...]
    rate: RopeState


def span_of(length: Scalar, track: Track) -> Scalar:
    """Span in m between the supports of a rope of a length in m."""
    spacing = track.roller_spacing
    return where(spacing > 0, minimum(length, spacing), length) if present(spacing) else length


def lumped_mass(rope: RopeLaw, length: Scalar) -> Scalar:
    """Mass in kg of one segment of a rope of a length in m."""
    return rope.mass_per_length * maximum(length, rope.shortest_mass) / rope.segments


def rope_on_drum(rope: RopeLaw, length: Scalar, track: Track) -> Scalar:
    """Mass in kg of the rope that turns with the drum while `length` m are paid out, half a segment included."""
    if not present(rope.mass_per_length):
        return 0.0
    wound = maximum(track.length + track.rope_offset - length, 0.0) + rope.spare_length
    return rope.mass_per_length * wound + end_mass(rope, length)


def end_mass(rope: RopeLaw, length: Scalar) -> Scalar:
    """Mass in kg that moves with either end of a rope of a length in m: half of a segment."""
    return lumped_mass(rope, length) / 2 if present(rope.mass_per_length) else 0.0


def blank_rope(rope: RopeLaw) -> RopeState:
    """A rope state with placeholder values, for the names of its elements."""
    return resting_rope(rope, 1.0, 1.0, Track(), 0.0)[0] if is_heavy(rope) or present(rope.hysteresis) else MASSLESS


def is_heavy(rope: RopeLaw) -> bool:
    """Whether a rope has mass or weight."""
    return present(rope.mass_per_length) or present(rope.submerged_weight)


def resting_rope(rope: RopeLaw, tension: Scalar, length: Scalar, track: Track, way: Scalar) -> tuple[RopeState, Scalar]:
    """State of a rope of a length in m at rest under a tension in N, and the stretch of its chord in m.

    `way` is the displacement of the vehicle towards the winch in m.
    """
    stretch, sag = rope.resting_stretch(tension, length), NO_STATE
    if present(rope.submerged_weight):
        span = span_of(length, track)
        depth = rope.submerged_weight * span**2 / (8 * tension)
        stretch, sag = stretch - arc(depth, span) * length, Sag(depth, 0.0)
    return RopeState(_evenly(rope, way + stretch, stretch, 0.0, 0.0), sag, _unused(rope)), stretch


def _unused(rope: RopeLaw) -> Any:
    """Hysteresis of a rope that has not been strained."""
    return Hysteresis(0.0) if present(rope.hysteresis) else NO_STATE


def _evenly(rope: RopeLaw, wound: Scalar, stretch: Scalar, wound_rate: Scalar, stretch_rate: Scalar) -> Any:
    """Inner nodes of a rope that is stretched evenly."""
    n = rope.segments
    if n == 1 or not present(rope.mass_per_length):
        return NO_STATE
    shares = [node / n for node in range(1, n)]
    return Waves(
        vector([wound - share * stretch for share in shares]),
        vector([wound_rate - share * stretch_rate for share in shares]),
    )


PASSES = 3
"""Fixed-point iterations for node speeds and drag of a moving rope; each reduces the error by a factor of 1e4."""


def steady_rope(
    rope: RopeLaw, tension: Scalar, length: Scalar, track: Track, way: Scalar, speed: Scalar, *, density: Scalar
) -> tuple[RopeState, Scalar, Scalar]:
    """State of a rope at constant tensions while the vehicle moves, and the rope wound in m and its rate in m/s.

    The strain of every segment is constant, and the depth of the sag is that at rest. Along the rope the tension
    differs by drag and roller friction.

    The tension in N is that at the drum, the length in m, the density that of the water in kg/m³. The vehicle is
    displaced by `way` in m and moves at `speed` in m/s, both towards the winch.
    """
    waves = rope.segments > 1 and present(rope.mass_per_length)
    n = rope.segments if waves else 1
    speeds, positions, depth = [speed] * (n + 1), [way] * (n + 1), 0.0
    for _ in range(PASSES if is_heavy(rope) else 1):
        tangential_drag = drag_along(rope, speeds, length, track, density)
        pulls = [tension - tangential_drag[0]]
        for near, far in pairwise(tangential_drag):
            pulls.append(pulls[-1] - near - far)
        surplus, growth = 0.0, 0.0
        if present(rope.submerged_weight):
            span = span_of(length, track)
            depth = rope.submerged_weight * span**2 / (8 * sum(pulls) / n)
            longer = arc(depth, span)
            surplus, growth = longer * length, longer if present(track.roller_spacing) else -longer
        for node in reversed(range(n)):
            damping = rope.tangent(pulls[node], length)[1]
            # the sag's share of the rate does not strain the damper
            elastic_pull = pulls[node] - damping * growth * speed
            stretch, slope = rope.steady_stretch(elastic_pull, length, -speed)
            positions[node] = positions[node + 1] + (stretch - surplus) / n
            speeds[node] = speeds[node + 1] - (slope - growth) * speed / n
    inner = Waves(vector(positions[1:-1]), vector(speeds[1:-1])) if waves else NO_STATE
    sag = Sag(depth, 0.0) if present(rope.submerged_weight) else NO_STATE
    return RopeState(inner, sag, _unused(rope)), positions[0], speeds[0]


def arc(depth: Scalar, span: Scalar) -> Scalar:
    """Share by which a parabola of a depth is longer than its chord, both in m, to second order."""
    return 8 / 3 * (depth / span) ** 2


def sag_shortening(rope: RopeLaw, tension: Scalar, length: Scalar, track: Track) -> Scalar:
    """Excess of a rope's arc over its chord in m, for the sag at rest under a tension in N."""
    if not present(rope.submerged_weight):
        return 0.0
    span = span_of(length, track)
    return arc(rope.submerged_weight * span**2 / (8 * maximum(tension, LEAST_PULL)), span) * length


def ernst_factor(weight: Scalar, span: Scalar, tension: Scalar, rigidity: Scalar) -> Scalar:
    """Tangent stiffness of a sagging rope over that without weight: 1/(1 + lambda²/12) (Ernst 1965).

    From the weight in N/m, the span in m, the tension in N and the rigidity E A in N.
    """
    slope = weight * span / tension
    return 1 / (1 + slope * slope * rigidity / (12 * tension))


def mode_error(ernst: float) -> float:
    """Share by which one mode a span puts a rope's first symmetric frequency too high, at an `ernst_factor`.

    Galerkin's mode has ``(w s)² m/T = 10 (1 + lambda²/12)``; the exact frequency of a span between fixed ends is the
    first root of ``tan x = x − 4 x³/lambda²`` with x = w s sqrt(m/T)/2 (Irvine 1981, Section 3.2).

    Example:
        >>> [f"{mode_error(1 / (1 + square / 12)):.2f}" for square in (1, 15, 100)]
        ['0.01', '0.02', '0.18']
    """
    square, low, high = 12 * (1 / ernst - 1), math.pi / 2, 3 * math.pi / 2
    while high - low > sys.float_info.epsilon * high:  # bisection of the equation times the cosine, without poles
        x = (low + high) / 2
        if x in (low, high):
            break
        is_below = math.sin(x) > (x - 4 * x**3 / square) * math.cos(x)
        low, high = (x, high) if is_below else (low, x)
    return math.sqrt(10 / ernst) / (2 * low) - 1


def first_mode(mass_per_length: Scalar, length: Scalar, rigidity: Scalar) -> Scalar:
    """First longitudinal mode in rad/s of a fixed–free rope (c/4L), from kg/m, length in m and `rigidity` E A in N."""
    return math.pi / 2 * sqrt(rigidity / mass_per_length) / length


def wire_rope_mass(diameter: Scalar) -> Scalar:
    """Mass in kg/m of a wire rope (6x36, steel core), diameter in m: 0.409 d² for 100 m, d in mm (EN 12385-4)."""
    return 4090.0 * diameter * diameter


STEEL, GRAVITY = 7850.0, 9.81
"""Density of steel in kg/m³ and gravity in m/s²."""


def weight_in_water(mass_per_length: Scalar, density: Scalar) -> Scalar:
    """Weight in N/m of a steel rope (mass in kg/m) in water of a density in kg/m³."""
    return mass_per_length * GRAVITY * (1 - density / STEEL)


def transverse_mass(rope: RopeLaw) -> Scalar:
    """Mass in kg/m that moves with the sag, that of the rope and the added mass of the water.

    Where the rope's mass is left out, at least that of a wire rope of its diameter: without a mass it could not sag.
    """
    if present(rope.mass_per_length):
        return rope.mass_per_length + rope.added_mass_per_length
    return maximum(rope.added_mass_per_length, wire_rope_mass(rope.diameter))


LEAST_PULL = 50.0
"""Lower bound of the tension in N for the sag, which grows without bound at zero."""


def rope_pull(
    rope: RopeLaw, state: RopeState, ends: RopeEnds, track: Track, *, density: Scalar, slack: bool, step: Scalar = 0.0
) -> RopePull:
    """Tensions of a rope, and the rates of its state, in water of a density in kg/m³.

    A rope that does not go `slack` may push. The hysteresis rate is its mean over a step in s, and tensions are those
    at its end (`bristle_rate`).
    """
    n, length, inverse_length = rope.segments if isinstance(state.waves, Waves) else 1, ends.length, ends.inverse_length
    surplus, surplus_rate = 0.0, 0.0  # excess of the arc over the chord of the whole rope in m
    steep = 0.0  # depth of the sag over the span squared
    if isinstance(state.sag, Sag):
        spans = maximum(inverse_length, 1 / track.roller_spacing) if present(track.roller_spacing) else inverse_length
        steep = state.sag.depth * spans**2  # without a division
        surplus = 8 / 3 * steep * state.sag.depth * length
        surplus_rate = 16 / 3 * steep * state.sag.rate * length
    inner_speeds = [state.waves.speed[node] for node in range(n - 1)]
    speeds = [ends.wound_rate, *inner_speeds, ends.wound_rate - ends.stretch_rate]
    stretches, rates = [ends.stretch], [ends.stretch_rate]
    if isinstance(state.waves, Waves):
        nodes = [ends.wound, *(state.waves.position[node] for node in range(n - 1)), ends.wound - ends.stretch]
        stretches = [n * (near - far) for near, far in pairwise(nodes)]
        rates = [n * (near - far) for near, far in pairwise(speeds)]
    rubbing, hysteresis = 0.0, NO_STATE
    if isinstance(state.hysteresis, Hysteresis):
        # more rope at constant strain has more stretch, and more spans of the same sag; neither changes the strain
        stretch = ends.stretch + (0.0 if present(track.roller_spacing) else 2 * surplus)
        growing = stretch * inverse_length * (ends.stretch_rate - ends.wound_rate)
        straining = (ends.stretch_rate + surplus_rate - growing) * inverse_length
        hysteresis = Hysteresis(bristle_rate(state.hysteresis.share, straining / rope.hysteresis_strain, 1.0, step))
        rubbing = rope.hysteresis * (state.hysteresis.share + step * hysteresis.share)
    tensions = []
    for stretch, rate in zip(stretches, rates, strict=True):
        pull = rope.pull(stretch + surplus, rate + surplus_rate, length, inverse_length) + rubbing
        tensions.append(one_sided(stretch + surplus, pull) if slack else pull)
    tangential_drag = drag_along(rope, speeds, length, track, density)
    waves, sag = NO_STATE, NO_STATE
    if isinstance(state.waves, Waves):
        lightest = 1 / maximum(rope.shortest_mass, SHORTEST_ROPE)
        ease = n / rope.mass_per_length * minimum(inverse_length, lightest)  # 1/lumped_mass
        forces = [tensions[k] - tensions[k + 1] - tangential_drag[k] - tangential_drag[k + 1] for k in range(n - 1)]
        waves = Waves(state.waves.speed, vector([force * ease for force in forces]))
    if isinstance(state.sag, Sag):
        rate, mean = state.sag.rate, sum(tensions) / n
        across = 16 / 35 * 0.5 * density * rope.cross_drag * rope.diameter * absolute(rate) * rate
        lifting = 16 / 3 * mean * steep
        modal_mass = 8 / 15 * transverse_mass(rope)
        sag = Sag(rate, (2 / 3 * rope.submerged_weight - lifting - across) / modal_mass)
    return RopePull(
        at_drum=tensions[0] + tangential_drag[0],
        at_vehicle=tensions[-1] - tangential_drag[-1],
        segments=tuple(tensions),
        rate=RopeState(waves, sag, hysteresis),
    )


ROLLING_SPEED = Vehicle.friction_velocity
"""Speed of the rope in m/s over which roller friction changes its sign, as that of the rail (A3)."""


def drag_along(rope: RopeLaw, speeds: Sequence[Scalar], length: Scalar, track: Track, density: Scalar) -> list[Scalar]:
    """Resistance in N at either end of each segment, half of the segment's `rope_drag` at its mean speed.

    `speeds` in m/s are those of the segments' ends, from the drum to the vehicle.
    """
    n = len(speeds) - 1
    means = [(near + far) / 2 for near, far in pairwise(speeds)]
    return [rope_drag(rope, mean, length, track, density) / (2 * n) for mean in means]


def rope_drag(rope: RopeLaw, speed: Scalar, length: Scalar, track: Track, density: Scalar) -> Scalar:
    """Resistance in N of water and rollers to a whole rope that moves at a speed in m/s."""
    skin = 0.5 * density * rope.skin_friction * math.pi * rope.diameter * length
    rollers = track.roller_friction * rope.submerged_weight * length
    return skin * absolute(speed) * speed + rollers * tanh(speed / ROLLING_SPEED)
