"""Effects missing from a plant that would determine the gains: winch inertia, sag, and waves in heavy ropes (A14).

Each is reported with its number, the limit beyond which it matters, and the keys that add it to the plant:

1. *Winch inertia.* Below 20 R² a winch is lighter than a rim of 20 kg; a steel drum with its rotor and wound rope has
   150 to 250 kg m² for R = 0.8 m.
2. *Sag.* Above w s/T = 0.1 a rope of the weight w a metre between points s apart is no straight line, and below 0.5
   Ernst's factor, 1/(1 + (w s)² E A/(12 T³)), leaves less than half of its stiffness (Ernst, *Der Bauingenieur* 40,
   1965). T is the smallest tension that the controller commands.
3. *Rope mass.* A rope's first longitudinal mode lies at c/4L. It is within the position loop's bandwidth if the loop
   gain there, times the mode's resonance Q = m omega/c with modal mass m = 4/pi² mu L, reaches 1.

For a Kelvin–Voigt rope without mass or weight, both are those of a wire rope of its diameter (EN 12385-4) in water.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.arguments import instance
from dualwinch.model.heavy_ropes import ernst_factor, first_mode, mode_error, span_of, weight_in_water, wire_rope_mass
from dualwinch.model.plant import Plant, Side
from dualwinch.model.ropes import is_kelvin_voigt, rope_lengths
from dualwinch.model.scalar import Scalar, present
from dualwinch.model.vehicle import inertia
from dualwinch.model.winch import total_inertia
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.prepare import PreparedExperiment, prepare


@dataclass(frozen=True)
class Idealisation:
    """An effect of real machines that is missing from a plant.

    Attributes:
        name: name of the effect.
        parts: parts of the plant without the effect, such as ``rope_1``.
        statement: in one line, with numbers.
        brief: the same in a few words.
        value, limit: the number and its limit; NaN if the plant's data do not determine them.
        unit: unit of both.
        keys: keys that add the effect to the plant.
    """

    name: str
    parts: tuple[str, ...]
    statement: str
    brief: str
    value: float
    limit: float
    unit: str
    keys: tuple[str, ...]


@dataclass(frozen=True)
class IdealisationLimits:
    """Limits beyond which an effect is reported.

    Attributes:
        rim: least inertia of a winch over the square of its drum's radius in kg.
        slope: largest w s/T.
        ernst: smallest Ernst factor.
        gain: largest gain of the position loop at a rope's first mode, including its resonance.
        amplitude: amplitude of the vehicle's speed in m/s for that gain.
    """

    rim: float = 20.0
    slope: float = 0.1
    ernst: float = 0.5
    gain: float = 1.0
    amplitude: float = 1e-3


@dataclass(frozen=True)
class IdealisationCheck:
    """A number of a plant and its limit, as floats or symbols.

    Attributes:
        name, part, unit, keys: as in an `Idealisation` of one part.
        value, limit: the number and its limit.
        words, brief: format strings of the long and the short statement.
        facts: further values for these formats.
        at_least: whether the limit is a lower one; else an upper one.
    """

    name: str
    part: str
    value: Scalar
    limit: Scalar
    words: str
    brief: str
    unit: str
    keys: tuple[str, ...]
    facts: Mapping[str, Scalar] = field(default_factory=dict)
    at_least: bool = True

    def idealisation(self) -> Iterator[Idealisation]:
        """Yield the idealisation if the number is beyond its limit."""
        value, limit = float(self.value), float(self.limit)
        if value < limit if self.at_least else value > limit:
            facts = {"value": value, "limit": limit, **self.facts}
            words = self.words.format(**facts), self.brief.format(**facts)
            yield Idealisation(self.name, (self.part,), *words, value, limit, self.unit, self.keys)


def idealisation_checks(
    plant: Plant, tension: Scalar, limits: IdealisationLimits | None = None
) -> list[IdealisationCheck]:
    """Checks for missing effects from the plant's data alone, at the smallest commanded tension in N."""
    limits, checks = limits or IdealisationLimits(), list[IdealisationCheck]()
    for side in plant.sides:
        part, rope = f"winch_{side.number}", f"rope_{side.number}"
        keys = f"plant.{part}.inertia", f"plant.{part}.rotor_inertia"
        words = "of {value:.3g} kg m² at the drum, below {rim:g} R² = {limit:.3g} kg m²"
        brief = f"of {{value:.3g}} kg m² ({limits.rim:g} R² = {{limit:.3g}})"
        drum, rim, facts = total_inertia(side.winch), side.winch.drum_radius**2 * limits.rim, {"rim": limits.rim}
        checks.append(IdealisationCheck("winch inertia", part, drum, rim, words, brief, "kg m^2", keys, facts))
        line = _rope_line(side, plant)
        if line is None:
            continue
        length = plant.track.length + plant.track.rope_offset
        span = span_of(length, plant.track)
        spring, _ = side.rope.tangent(tension, length)
        facts = {"tension": tension, "span": span, "weight": line.weight, "diameter": 1e3 * side.rope.diameter}
        keys = (f"plant.{rope}.submerged_weight", "plant.track.roller_spacing")
        sagging = present(side.rope.submerged_weight)
        lack = ONE_MODE if sagging else line.without
        if not sagging:
            words = (
                f"{lack}: {line.what} weighs {{weight:.3g}} N/m in water, w s/T = {{value:.3g}} > {{limit:g}} {PLACE}"
            )
            brief, slope = f"{lack} (w s/T = {{value:.3g}} {AT})", line.weight * span / tension
            sag = IdealisationCheck("sag", rope, slope, limits.slope, words, brief, "1", keys, facts, at_least=False)
            checks.append(sag)
        words = (
            f"{lack}: sag leaves {{value:.2g}} of the stiffness of {line.what} {PLACE} (Ernst's factor, < {{limit:g}})"
        )
        brief = f"{lack} (Ernst's factor {{value:.2g}} {AT})"
        ernst = ernst_factor(line.weight, span, tension, spring * length)
        check = IdealisationCheck("stiffness under sag", rope, ernst, limits.ernst, words, brief, "1", keys, facts)
        checks.append(check)
    return checks


ONE_MODE = "with one transverse mode a span"
AT = "at {tension:g} N"
PLACE = f"{AT} over {{span:.3g}} m"


class _RopeLine(NamedTuple):
    """A rope's mass in kg/m and weight in water in N/m, its own or a wire rope's; descriptions of it and its lack."""

    mass: Scalar
    weight: Scalar
    what: str
    without: str


def _rope_line(side: Side, plant: Plant) -> _RopeLine | None:
    """The rope's line data; None if they are unknown."""
    rope = side.rope
    owned = {"mass": present(rope.mass_per_length), "weight": present(rope.submerged_weight)}
    without = f"without {' and '.join(name for name, has_it in owned.items() if not has_it)}"
    if all(owned.values()):
        return _RopeLine(rope.mass_per_length, rope.submerged_weight, "the rope", without)
    if not is_kelvin_voigt(rope):
        return None
    mass = rope.mass_per_length if owned["mass"] else wire_rope_mass(rope.diameter)
    weight = rope.submerged_weight if owned["weight"] else weight_in_water(mass, plant.vehicle.water_density)
    return _RopeLine(mass, weight, "a wire rope of {diameter:.3g} mm", without)


def idealisations(experiment: Experiment, limits: IdealisationLimits | None = None) -> list[Idealisation]:
    """Effects of real machines that are missing from an experiment's plant; equal entries of both sides are merged.

    Args:
        experiment: the plant, and the controller that determines which effects matter.
        limits: limits beyond which they are reported.

    Raises:
        ConfigurationError: the experiment's values are inconsistent.

    Example:
        >>> import dualwinch as dw
        >>> [effect.name for effect in dw.idealisations(dw.case(4))]
        ['winch inertia', 'sag', 'stiffness under sag']
    """
    instance("experiment", experiment, Experiment)
    limits, plant = limits or IdealisationLimits(), experiment.plant
    checks = idealisation_checks(plant, experiment.controller.limits.tension_min, limits)
    every = [_with_mode_error(one) for check in checks for one in check.idealisation()]
    every += [one for side in plant.sides for one in _rope_mass(side, experiment, limits)]
    by_name: dict[str, Idealisation] = {}
    for one in every:
        same = by_name.get(one.statement)
        both = {} if same is None else {"parts": same.parts + one.parts, "keys": same.keys + one.keys}
        by_name[one.statement] = replace(one, **{name: tuple(dict.fromkeys(each)) for name, each in both.items()})
    return [replace(one, statement=f"{_subject(one.parts)} {one.statement}") for one in by_name.values()]


def summary(simplifications: Sequence[Idealisation]) -> str:
    """All idealisations in one line, each key's lack once; empty where there are none."""
    named, briefs = set[str](), list[str]()
    for one in simplifications:
        if not named.issuperset(one.keys):
            briefs.append(f"{_subject(one.parts)} {one.brief}")
            named.update(one.keys)
    return f"idealised: {', '.join(briefs)}; see docs/site.md" if simplifications else ""


def _subject(parts: Sequence[str]) -> str:
    """E.g. ``winches``, or ``rope 1``."""
    both = {"winch_1": "winches", "rope_1": "ropes"}
    return both[parts[0]] if len(parts) > 1 else parts[0].replace("_", " ")


def _with_mode_error(one: Idealisation) -> Idealisation:
    """What one transverse mode a span is wrong by beside the stiffness that sag leaves."""
    if not one.statement.startswith(ONE_MODE):
        return one
    error = f"its first frequency up to {100 * mode_error(one.value):.2g} % too high"
    return replace(one, statement=f"{one.statement}, {error}", brief=f"{one.brief}, {error}")


def _rope_mass(side: Side, experiment: Experiment, limits: IdealisationLimits) -> Iterator[Idealisation]:
    """Report a rope modelled without waves though its first mode is within the loop's bandwidth, or of unknown mass."""
    rope, parts, key = side.rope, (f"rope_{side.number}",), f"plant.rope_{side.number}"
    line = _rope_line(side, experiment.plant)
    if line is None:
        absent_numbers = [name for name in ("mass_per_length", "submerged_weight") if not getattr(rope, name)]
        words, keys = "without " + " and ".join(absent_numbers), tuple(f"{key}.{name}" for name in absent_numbers)
        words = words.replace("_per_length", "").replace("submerged_", "")
        yield Idealisation("rope mass", parts, words, words, math.nan, math.nan, "kg/m", keys)
    elif not rope.mass_per_length or rope.segments == 1:
        length = experiment.plant.track.length + experiment.plant.track.rope_offset
        spring, damping = rope.tangent(experiment.controller.limits.tension_min, length)
        omega = float(first_mode(line.mass, length, spring * length))
        resonance = 4 / math.pi**2 * line.mass * length * omega / damping if damping else math.inf
        peak, hertz = position_loop_gain(experiment, omega, limits.amplitude) * resonance, omega / (2 * math.pi)
        if peak >= limits.gain:
            what = line.what.format(diameter=1e3 * rope.diameter)
            words = (
                f"without waves: first mode of {what} at {hertz:.3g} Hz, loop gain {peak:.3g} >= {limits.gain:g} there"
            )
            brief = f"without waves (loop gain {peak:.3g} at {hertz:.3g} Hz)"
            keys = (f"{key}.mass_per_length", f"{key}.segments")
            yield Idealisation("rope mass", parts, words, brief, peak, limits.gain, "1", keys)


STEADY_PLANT = {
    "plant.vehicle.friction_coefficient": 0.0,
    "nominal.vehicle.friction_coefficient": 0.0,
    "sensors.position_resolution": 0.0,
    "sensors.encoder_counts": 0.0,
    "sensors.drum_speed_resolution": 0.0,
}
"""Values that remove stiction and quantisation, so that the response to small motions about rest is linear."""


@lru_cache(maxsize=8)  # the same of both ropes, as a rule
def position_loop_gain(
    experiment: Experiment, omega: float, amplitude: float = 1e-3, periods: float = 4.0, samples: int = 500
) -> float:
    """Gain of the loop opened at the force command u, at one frequency and amplitude: a describing function.

    1. Vehicle and drums oscillate about the start as if driven by a sinusoidal net rope force, while the controller
       runs on measured tensions that include this force.
    2. The gain is the first harmonic of the force command over the force, by least squares over the second half of the
       periods. Half the difference of runs with opposite signs cancels even transients.

    Args:
        experiment: with ropes without waves.
        omega: angular frequency in rad/s.
        amplitude: of the vehicle's speed in m/s; reduced where the force would exceed half of a rope's tension at rest.
        periods: number of periods of the oscillation.
        samples: maximum number of samples, which may reduce the periods to one. For still lower frequencies the gain
            at the lowest feasible one is returned, a lower bound, as loop gains fall with frequency.
    """
    ready, step, plant = prepare(experiment), experiment.simulation.sample_time, experiment.plant
    if omega * step > math.pi:  # beyond the Nyquist frequency
        return 0.0
    omega = max(omega, 2 * math.pi / (samples * step))
    loop, tension, mass = ready.loop, experiment.controller.limits.preload / 2, inertia(plant.vehicle)
    amplitude = min(amplitude, tension / 2 / (mass * omega))
    force = 1j * omega * mass * amplitude  # a phasor, like the motions
    moving = {"x": amplitude / (1j * omega), "v": amplitude}
    for side, length in zip(plant.sides, rope_lengths(ready.start["motion.plant.x"], plant.track), strict=True):
        spring, damping = side.rope.tangent(tension, length)
        way = side.direction * (moving["x"] + force / 2 / (spring + 1j * omega * damping))
        turn = way / side.winch.drum_radius
        shafts = [f"{{}}_{side.number}"]
        shafts += [f"motor_{side.number}.{{}}"] if f"motion.plant.motor_{side.number}.theta" in loop.states else []
        for shaft in shafts:
            moving |= {shaft.format("theta"): turn, shaft.format("omega"): 1j * omega * turn}
    t = step * np.arange(math.ceil(min(periods * 2 * math.pi / omega / step, samples)))
    paths = {loop.states.index(f"motion.plant.{name}"): (p * np.exp(1j * omega * t)).real for name, p in moving.items()}
    commands = (_commands(ready, {index: sign * path for index, path in paths.items()}) for sign in (1, -1))
    odd = np.subtract(*commands) / 2
    second_half, fitted = t >= t[-1] / 2, np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones_like(t), t])
    (cosine, sine, *_), *_ = np.linalg.lstsq(fitted[second_half], odd[second_half])
    return math.hypot(cosine, sine) / abs(force)


def _commands(ready: PreparedExperiment, paths: Mapping[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Force commands in N while states follow given deviations from the start: index of the state → (samples,)."""
    loop, state, start = ready.loop, ready.state, ready.state
    parameters = loop.vector({key: STEADY_PLANT.get(key, value) for key, value in ready.parameters.items()})
    outside, motion, command = np.zeros(len(loop.exogenous)), loop.move.numel_in("motion"), loop.columns.index("u")
    commands = []
    for deviations in zip(*paths.values(), strict=True):
        for index, deviation in zip(paths, deviations, strict=True):
            state[index] = start[index] + deviation
        commands.append(float(loop.observe(state, outside, parameters)[command]))
        discrete, *_ = loop.sample(state, outside, parameters)
        state[motion:] = discrete.full().ravel()
    return np.array(commands)
