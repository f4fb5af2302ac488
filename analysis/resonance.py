"""Drum resonance on the ropes: a rule for gains that keep it damped (docs/site.md).

Every drum oscillates on its rope. For any rope stiffness k, the tension at ``omega = sqrt(k/m)`` exceeds its command by
the factor ``k/(omega c)``, and there the law's force, which is proportional to the speed error e2 and acts through the
vehicle's mass, returns with the phase of an excitation. The loop gain at the resonance is then::

    (L + slope + ki G/R) m / (c (1 + kp G/R) + damping G/R²)

with the observer's gain L, the slope of the law for an amplitude of the speed error (its describing function), the
moving mass ``m = J/R² + wound rope + 4/pi² mu length`` and the rope's damping c in N s/m. Its bound is 1. The gains
kp and ki of the tension loop and the drum's damping enter as in the equation of the drum: as forces proportional to its
speed. Where the tension command is shaped (`controllers.coordinations.command_shaping`), L and the slope act through
that filter of the nominal machine. The phase of a loop with a well-damped drum changes slowly, so that lags shift its
bound further than that of an undamped one: eigenvalues decide there, too.

At mid-track both drums oscillate alike and act together. Elsewhere only one oscillates, with half of the force, and the
law may be twice as steep. Effects outside the rule (delays, motors, gearboxes, sag, an estimator) shift the bound:
between 0.8 and 1.25 the rule is inconclusive (`UNDECIDED`), and eigenvalues decide.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.describing_function import LARGEST_SPEED_ERROR, DescribingGains
from dualwinch.analysis.margins import comparable
from dualwinch.analysis.stability import sliding_mode
from dualwinch.codegen.source.expressions import built_once
from dualwinch.controllers.coordinations.command_shaping import attenuation, drum_resonance
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.observer import inference
from dualwinch.model.drum_on_rope import moving_mass, wave_impedance
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.ropes import rope_lengths
from dualwinch.model.scalar import Scalar, present, sqrt
from dualwinch.model.vehicle import inertia
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import LoopStructure, parameters_of, structure_of, symbolic_parts

Floats = NDArray[np.float64]

AMPLITUDES = (1e-4, 1e-3, 1e-2, 3e-2, 1e-1, LARGEST_SPEED_ERROR)
"""Default amplitudes of the speed error in m/s."""

RULE_AMPLITUDES = tuple(np.geomspace(1e-4, LARGEST_SPEED_ERROR, 25).tolist())
"""Amplitudes of the speed error in m/s at which large-signal stability is examined."""

RESONANCE, LARGE_SIGNAL = "resonance", "large_signal"
"""Names of its margins, the factor on the loop gain at the resonance that makes it 1: at small speed errors, and at all
up to the largest."""

MARGIN_AMPLITUDES = {RESONANCE: AMPLITUDES[:3], LARGE_SIGNAL: AMPLITUDES}
"""Name of a margin → amplitudes of the speed error in m/s of which it is the smallest."""

THRESHOLD, OF_ONE_DRUM = 1.0, 2.0
"""Largest loop gains: with both drums oscillating alike, and with only one."""

UNDECIDED = (0.8, 1.25)
"""Range of loop gains in which the rule is inconclusive: it contains the bounds found by eigenvalues (docs/site.md)."""

LINEAR_SPEED = "controller.nftsm.linear_speed"
"""Key of the speed error above which the law is linear; absent where it is a power throughout."""


@dataclass(frozen=True)
class ResonanceGain:
    """The loop gain at the resonance of a drum on its rope, for one amplitude of the speed error."""

    amplitude: Annotated[float, Quantity("m/s", "amplitude of the speed error")]
    winch: Annotated[int, Quantity("1", "number of the winch")]
    frequency: Annotated[float, Quantity("Hz", "frequency of the drum on its rope, taut and with a rigid gearbox")]
    feedback: Annotated[float, Quantity("1/s", "observer gain, slope of the law and integral gain of the tension")]
    mass: Annotated[float, Quantity("kg", "moving mass at the drum's rim")]
    damping: Annotated[float, Quantity("N s/m", "damping by the rope and the winch controller")]
    gain: Annotated[float, Quantity("1", "loop gain at the resonance: feedback mass/damping, at most 1")]

    @property
    def verdict(self) -> str:
        """``holds``, ``fails``, or ``undecided`` near 1."""
        low, high = UNDECIDED
        return "holds" if self.gain < low else "fails" if self.gain > high else "undecided"


def resonance_gains(
    experiment: Experiment,
    x: float | None = None,
    *,
    nominal: Plant | None = None,
    amplitudes: Sequence[float] = AMPLITUDES,
) -> list[ResonanceGain]:
    """Loop gains at the resonances of both drums on their ropes, by the rule of `analysis.resonance`.

    Args:
        experiment: plant and gains.
        x: position in m; default: mid-track, where both drums act together.
        nominal: the plant the controller was designed for; default: the experiment's.
        amplitudes: of the speed error in m/s.

    Raises:
        ConfigurationError: a law without odd powers of the speed error.

    Example:
        >>> import dualwinch as dw
        >>> drum, _ = dw.resonance_gains(dw.case(4), amplitudes=[0.01])
        >>> f"{drum.gain:.3f} at {drum.frequency:.0f} Hz: {drum.verdict}"
        '0.031 at 113 Hz: holds'
    """
    sliding_mode(experiment, "the rule applies to laws with odd powers of the speed error; must be")
    values = parameters_of(experiment, nominal)
    at = experiment.plant.track.length / 2 if x is None else x
    terms = resonance_terms(structure_of(experiment), np.array([list(values.values())]), np.array([at]), amplitudes)
    return [
        ResonanceGain(amplitude, number, *(float(value) for value in of_winch))
        for amplitude, of_amplitude in zip(amplitudes, terms[0], strict=True)
        for number, of_winch in enumerate(of_amplitude, start=1)
    ]


def largest_gain(gains: Sequence[ResonanceGain]) -> ResonanceGain:
    """The drum with the largest loop gain; the first of those that only rounding distinguishes."""
    return max(gains, key=lambda drum: float(comparable(drum.gain)))


def matched_damping(experiment: Experiment, winch: int) -> float:
    """Damping of a drum's speed, in N m s/rad at the motor, that matches the wave impedance of its rope at mid-track.

    ``sqrt(EA mu) R²/G``, with the tangent of the rope at half the preload (`controllers.coordinations.winch_pid`).
    """
    plant = experiment.plant
    side, length = plant.sides[winch - 1], plant.track.length / 2 + plant.track.rope_offset
    impedance = wave_impedance(side.rope, experiment.controller.limits.preload / 2, length)
    return float(impedance * side.winch.drum_radius**2 / side.winch.gear_ratio)


def resonance_terms(
    structure: LoopStructure, parameters: Floats, x: Floats, amplitudes: Sequence[float] = AMPLITUDES
) -> Floats:
    """The rule for many machines and gains: (s, amplitudes, 2, 5), for both winches the numbers of a `ResonanceGain`.

    Parameters of the closed loop (s, parameters), positions (s,) in m, amplitudes of the speed error in m/s.
    """
    names = list(structure.parameters)
    p, q, smoothing = (parameters[:, names.index(f"controller.nftsm.{name}")] for name in ("p", "q", "smoothing"))
    linear = parameters[:, names.index(LINEAR_SPEED)] if LINEAR_SPEED in names else 0.0
    terms = []
    for amplitude in amplitudes:
        gains = DescribingGains.of(amplitude, p / q, smoothing, linear)
        inputs = np.array([x, np.full_like(x, amplitude), gains.terminal, gains.surface])
        terms.append(_terms(structure)(parameters.T, inputs).full().T.reshape(len(x), 2, -1))
    return np.stack(terms, axis=1)


@built_once
def _terms(structure: LoopStructure) -> ca.Function:
    """``(parameters, (x, amplitude, slopes of both powers)) -> terms`` for winches 1 and 2."""
    names = tuple(structure.parameters)
    vector, inputs = ca.SX.sym("parameters", len(names)), ca.SX.sym("inputs", 4)
    values = dict(zip(names, ca.vertsplit(vector), strict=True))
    x, amplitude, terminal, surface = ca.vertsplit(inputs)
    parts = symbolic_parts(structure, values)
    plant, controller = parts.plant, parts.controller
    nominal = with_leaves(structure.nominal, values, "nominal.")
    gains, coordination, no_loop = controller.law.nftsm, controller.coordination, WinchGains(0.0, 0.0)
    slope = gains.beta * gains.q / gains.p * terminal + (gains.eta + gains.k / gains.phi) / gains.beta * surface
    inertia_ratio = inertia(nominal.vehicle) / inertia(plant.vehicle)
    terms = []
    for side, sheet, length in zip(plant.sides, nominal.sides, rope_lengths(x, plant.track), strict=True):
        winch, rope = side.winch, side.rope
        loop = getattr(coordination, f"winch_{side.number}", no_loop).on(length, plant.track)
        to_force = winch.gear_ratio / winch.drum_radius
        mass = moving_mass(side, length, plant.track)
        spring, rope_damping = rope.tangent(controller.limits.preload / 2, length)
        omega = sqrt(spring / mass)
        law = inertia_ratio * (slope + _observer_gain(controller.law, amplitude, omega))
        if present(loop.shaping):
            tension = controller.limits.preload / 2
            law *= attenuation(omega, drum_resonance(sheet, tension, length, nominal.track, loop.damping), loop.shaping)
        feedback = law + loop.ki * to_force
        damping = rope_damping * (1 + loop.kp * to_force) + loop.damping * to_force / winch.drum_radius
        terms += [omega / (2 * math.pi), feedback, mass, damping, feedback * mass / damping]
    return ca.Function("resonance", [vector, inputs], [ca.densify(ca.vertcat(*terms))])


def _observer_gain(law: FandoNftsm, amplitude: Scalar, omega: Scalar) -> Scalar:
    """Largest gain in 1/s of the law's observer while the speed error oscillates; 0 without an observer.

    The input of its fuzzy rules is then the low-passed acceleration of the vehicle.
    """
    if not isinstance(law, FandoNftsm):
        return 0.0
    observer = law.observer
    error = amplitude * omega / sqrt(1 + (omega * observer.filter_time) ** 2)
    return observer.l0 + observer.kf * inference(error / observer.error_scale, omega * error / observer.rate_scale)
