"""What a plant leaves out that decides over gains: heavy winches, sag, and waves in ropes with mass (A14).

Each is stated with its number, the limit beyond which it matters, and the keys that put it into the plant:

1. *Winch inertia.* Below 20 R² a winch is lighter than a rim of 20 kg; a drum of steel, its rotor and the rope on it
   have 150 to 250 kg m² where R is 0.8 m.
2. *Sag.* Above w s/T = 0.1 a rope of the weight w a metre between points s apart is no straight line, and below 0.5
   Ernst's factor, 1/(1 + (w s)² E A/(12 T³)), leaves less than half of its stiffness (Ernst, *Der Bauingenieur* 40,
   1965). T is the smallest tension that the controller commands.
3. *Rope mass.* A rope's first longitudinal mode lies at c/4L. It is inside the position loop's bandwidth where the
   loop's gain there, times the mode's resonance Q = m omega/c with its modal mass m = 4/pi² mu L, reaches 1.

Of a Kelvin–Voigt rope without mass or weight both follow from its diameter, as of a wire rope (EN 12385-4) in water.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.heavy_ropes import ernst_factor, first_mode, span_of, weight_in_water, wire_rope_mass
from dualwinch.model.plant import Side
from dualwinch.model.ropes import is_kelvin_voigt, rope_lengths
from dualwinch.model.vehicle import inertia
from dualwinch.model.winch import total_inertia
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.prepare import PreparedExperiment, prepare


@dataclass(frozen=True)
class Idealisation:
    """An effect of a machine that a plant leaves out.

    Attributes:
        name: of the effect.
        parts: of the plant that leave it out, such as ``rope_1``.
        statement: in one line, with numbers.
        brief: the same in a few words.
        value, limit: the number and its limit; NaN where the plant's data say nothing of it.
        unit: of both.
        keys: that put it into the plant.
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
    """Limits beyond which an effect is stated.

    Attributes:
        rim: least inertia of a winch over the square of its drum's radius in kg.
        slope: largest w s/T.
        ernst: least Ernst's factor.
        gain: largest gain of the position loop at a rope's first mode, its resonance included.
        amplitude: of the vehicle's speed in m/s at which that gain is found.
    """

    rim: float = 20.0
    slope: float = 0.1
    ernst: float = 0.5
    gain: float = 1.0
    amplitude: float = 1e-3


def idealisations(experiment: Experiment, limits: IdealisationLimits | None = None) -> list[Idealisation]:
    """Effects that a machine has and the plant of an experiment leaves out, both sides in one where they are alike.

    Args:
        experiment: its plant, and the controller that decides which effects matter.
        limits: beyond which they are stated.

    Raises:
        ConfigurationError: the experiment's values do not fit together.
    """
    limits = limits or IdealisationLimits()
    found: dict[str, Idealisation] = {}
    for side in experiment.plant.sides:
        for one in (*_of_winch(side, limits), *_of_rope(side, experiment, limits)):
            same = found.get(one.statement)
            both = {} if same is None else {"parts": same.parts + one.parts, "keys": same.keys + one.keys}
            found[one.statement] = replace(one, **{name: tuple(dict.fromkeys(each)) for name, each in both.items()})
    return [replace(one, statement=f"{_subject(one.parts)} {one.statement}") for one in found.values()]


def summary(found: Sequence[Idealisation]) -> str:
    """All idealisations in one line; empty where there are none."""
    briefs: dict[tuple[str, ...], str] = {}
    for one in found:
        briefs.setdefault(one.keys, f"{_subject(one.parts)} {one.brief}")
    return f"idealised: {', '.join(briefs.values())}; see docs/site.md" if found else ""


def _subject(parts: Sequence[str]) -> str:
    """E.g. ``winches``, or ``rope 1``."""
    both = {"winch_1": "winches", "rope_1": "ropes"}
    return both[parts[0]] if len(parts) > 1 else parts[0].replace("_", " ")


def _of_winch(side: Side, limits: IdealisationLimits) -> Iterator[Idealisation]:
    own, least = total_inertia(side.winch), limits.rim * side.winch.drum_radius**2
    if own < least:
        part = f"winch_{side.number}"
        words = f"of {own:.3g} kg m² at the drum, below {limits.rim:g} R² = {least:.3g} kg m²"
        brief = f"of {own:.3g} kg m² ({limits.rim:g} R² = {least:.3g})"
        keys = f"plant.{part}.inertia", f"plant.{part}.rotor_inertia"
        yield Idealisation("winch inertia", (part,), words, brief, own, least, "kg m^2", keys)


def _of_rope(side: Side, experiment: Experiment, limits: IdealisationLimits) -> Iterator[Idealisation]:
    rope, track, tension = side.rope, experiment.plant.track, experiment.controller.limits.tension_min
    parts, key, length = (f"rope_{side.number}",), f"plant.rope_{side.number}.", track.length + track.rope_offset
    mass, weight, what = rope.mass_per_length, rope.submerged_weight, "the rope"
    missing = [words for words, own in (("mass", mass), ("weight", weight)) if not own]
    without = f"without {' and '.join(missing)}"
    if missing and not is_kelvin_voigt(rope):
        keys = f"{key}mass_per_length", f"{key}submerged_weight"
        yield Idealisation("rope mass", parts, without, without, math.nan, math.nan, "kg/m", keys)
        return
    if missing:
        what = f"a wire rope of {1e3 * rope.diameter:.3g} mm"
        mass = mass or wire_rope_mass(rope.diameter)
        weight = weight or weight_in_water(mass, experiment.plant.vehicle.water_density)
    (spring, damping), span = rope.tangent(tension, length), float(span_of(length, track))
    slope, ernst = weight * span / tension, float(ernst_factor(weight, span, tension, spring * length))
    where, keys = f"at {tension:g} N over {span:.3g} m", (f"{key}submerged_weight", "plant.track.roller_spacing")
    if slope > limits.slope and "weight" in missing:
        words = f"{without}: {what} weighs {weight:.3g} N/m in water, w s/T = {slope:.3g} > {limits.slope:g} {where}"
        yield Idealisation("sag", parts, words, f"{without} (w s/T = {slope:.3g})", slope, limits.slope, "1", keys)
    if ernst < limits.ernst:
        lack = without if "weight" in missing else "with one transverse mode a span"
        words = (
            f"{lack}: sag leaves {ernst:.2g} of the stiffness of {what} {where} (Ernst's factor, < {limits.ernst:g})"
        )
        brief = f"{lack} (Ernst's factor {ernst:.2g})"
        yield Idealisation("stiffness under sag", parts, words, brief, ernst, limits.ernst, "1", keys)
    if "mass" in missing or rope.segments == 1:
        omega = float(first_mode(mass, length, spring * length))
        resonance = 4 / math.pi**2 * mass * length * omega / damping if damping else math.inf
        peak, hertz = position_loop_gain(experiment, omega, limits.amplitude) * resonance, omega / (2 * math.pi)
        if peak >= limits.gain:
            words = (
                f"without waves: first mode of {what} at {hertz:.3g} Hz, loop gain {peak:.3g} >= {limits.gain:g} there"
            )
            brief = f"without waves (loop gain {peak:.3g} at {hertz:.3g} Hz)"
            keys = (f"{key}mass_per_length", f"{key}segments")
            yield Idealisation("rope mass", parts, words, brief, peak, limits.gain, "1", keys)


STEADY = {
    "plant.vehicle.friction_coefficient": 0.0,
    "nominal.vehicle.friction_coefficient": 0.0,
    "sensors.position_resolution": 0.0,
    "sensors.encoder_counts": 0.0,
}
"""Parameters without which the response to a small motion about rest is that in motion, and has no steps."""


def position_loop_gain(experiment: Experiment, omega: float, amplitude: float = 1e-3, periods: int = 4) -> float:
    """Gain of the loop opened at the force command u, at one frequency and amplitude: a describing function.

    1. Vehicle and drums oscillate about the start as a sinusoidal force of the ropes moves them, while the controller
       runs: the tensions that it measures carry that force.
    2. The gain is the first harmonic of its command over that force, by least squares, after half of the periods.
       Motions of either sign are run, and half of the difference is taken: transients that are even cancel.

    Args:
        experiment: with ropes without waves.
        omega: in rad/s.
        amplitude: of the vehicle's speed in m/s; less where the force would exceed half of a rope's tension at rest.
        periods: of the oscillation.
    """
    ready, step, plant = prepare(experiment), experiment.simulation.sample_time, experiment.plant
    if omega * step > math.pi:  # beyond the Nyquist frequency
        return 0.0
    loop, rest, mass = ready.loop, experiment.controller.limits.preload / 2, inertia(plant.vehicle)
    amplitude = min(amplitude, rest / 2 / (mass * omega))
    force = 1j * omega * mass * amplitude  # as a phasor, like all that moves
    moving = {"x": amplitude / (1j * omega), "v": amplitude}
    for side, length in zip(plant.sides, rope_lengths(ready.start["motion.plant.x"], plant.track), strict=True):
        spring, damping = side.rope.tangent(rest, length)
        way = side.direction * (moving["x"] + force / 2 / (spring + 1j * omega * damping))
        turn = way / side.winch.drum_radius
        moving |= {f"theta_{side.number}": turn, f"omega_{side.number}": 1j * omega * turn}
    t = step * np.arange(math.ceil(periods * 2 * math.pi / omega / step))
    paths = {loop.states.index(f"motion.plant.{name}"): (p * np.exp(1j * omega * t)).real for name, p in moving.items()}
    commands = (_commands(ready, {index: sign * path for index, path in paths.items()}) for sign in (1, -1))
    odd = np.subtract(*commands) / 2
    late, fitted = t >= t[-1] / 2, np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones_like(t), t])
    (cosine, sine, *_), *_ = np.linalg.lstsq(fitted[late], odd[late])
    return math.hypot(cosine, sine) / abs(force)


def _commands(ready: PreparedExperiment, paths: Mapping[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Force commands in N while states follow given deviations from the start: index of the state → (samples,)."""
    loop, state, start = ready.loop, ready.state, ready.state
    parameters = loop.vector(ready.parameters | STEADY)
    outside, motion, command = np.zeros(len(loop.exogenous)), loop.move.numel_in("motion"), loop.columns.index("u")
    found = []
    for deviations in zip(*paths.values(), strict=True):
        for index, deviation in zip(paths, deviations, strict=True):
            state[index] = start[index] + deviation
        found.append(float(loop.observe(state, outside, parameters)[command]))
        discrete, *_ = loop.sample(state, outside, parameters)
        state[motion:] = discrete.full().ravel()
    return np.array(found)
