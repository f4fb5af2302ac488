"""Shaping of a tension command at the resonance of a drum on its rope.

With the feedforward of the winch controller a drum of the mass m at its rim, on a rope of the stiffness k, follows a
tension command F_cmd in N as a second-order system of the frequency ``w = sqrt(k/m)`` and the damping ratio
``z = c/(2 m w)``, with the damping c of rope and motor::

    F/F_cmd = w²/(s² + 2 z w s + w²)

A lightly damped drum amplifies the force command by 1/(2 z) at its resonance, which limits the gain of the position law
at all frequencies. A filter replaces the poles by ones of a chosen damping ratio (notch filter; Ellis, Control System
Design Guide, 4th ed., 2012, Chapter 9)::

    N(s) = (s² + 2 z w s + w²)/(s² + 2 shaping w s + w²)

Frequency and damping are those of the nominal machine, at the present length of the rope and with Ernst's modulus at
the commanded tension. Its magnitude is at most 1 at every frequency, so that whatever the error of w and z it never
raises the loop gain; it costs a phase lag of about ``2 (shaping - z) omega/w`` below the resonance, for which the loop
needs phase margin. Where the damping z is larger already the command stays as it is.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from dualwinch.model.drum_on_rope import moving_mass, tangent_rigidity
from dualwinch.model.plant import Side
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.ropes import Track
from dualwinch.model.scalar import Scalar, has_begun, maximum, sqrt, where


class DrumResonance(NamedTuple):
    """Resonance of a drum on its rope: frequency in rad/s and damping ratio."""

    frequency: Scalar
    damping: Scalar


def drum_resonance(side: Side, tension: Scalar, length: Scalar, track: Track, damping: Scalar) -> DrumResonance:
    """Resonance of a drum on its rope of a length in m at a tension in N; `damping` as in `WinchGains`.

    Example:
        >>> import dualwinch as dw
        >>> plant = dw.Plant()
        >>> drum = drum_resonance(plant.sides[0], 500.0, 25.5, plant.track, damping=20.0)
        >>> f"{drum.frequency:.0f} rad/s, {drum.damping:.2f}"
        '710 rad/s, 0.53'
    """
    mass, rigidity = moving_mass(side, length, track), tangent_rigidity(side.rope, tension, length, track)
    frequency = sqrt(rigidity / (length * mass))
    by_motor = damping * side.winch.gear_ratio / side.winch.drum_radius**2
    return DrumResonance(frequency, (side.rope.tangent(tension, length)[1] + by_motor) / (2 * mass * frequency))


@dataclass(frozen=True)
class ShapedCommand:
    """State of the filter: its low-passed command and the rate of that."""

    force: Annotated[Scalar, Quantity("N", "tension command, low-passed at the drum's resonance")] = 0.0
    rate: Annotated[Scalar, Quantity("N/s", "rate of the low-passed tension command")] = 0.0


def shaped(
    state: ShapedCommand, command: Scalar, drum: DrumResonance, shaping: Scalar, sample_time: Scalar, primed: Scalar
) -> tuple[ShapedCommand, Scalar]:
    """One sample of the filter by backward Euler, stable for every frequency: next state and shaped command in N.

    ``N(s) F_cmd = F_cmd - 2 (shaping - z)/w dF/dt`` with F the low-passed command. Before the first sample (`primed`
    0) it is the command itself.
    """
    w, T = drum.frequency, sample_time
    force = where(has_begun(primed), state.force, command)
    rate = (state.rate + T * w**2 * (command - force)) / (1 + 2 * shaping * w * T + (w * T) ** 2)
    return ShapedCommand(force + T * rate, rate), command - 2 * maximum(shaping - drum.damping, 0.0) / w * rate


def attenuation(omega: Scalar, drum: DrumResonance, shaping: Scalar) -> Scalar:
    """Magnitude of the filter at an angular frequency in rad/s: z/shaping at the resonance, 1 far from it.

    Example:
        >>> drum = DrumResonance(50.0, 0.2)
        >>> [round(attenuation(omega, drum, 0.8), 2) for omega in (5.0, 50.0, 500.0)]
        [0.99, 0.25, 0.99]
    """
    apart = (drum.frequency**2 - omega**2) ** 2
    width = (2 * drum.frequency * omega) ** 2
    return sqrt((apart + drum.damping**2 * width) / (apart + maximum(shaping, drum.damping) ** 2 * width))
