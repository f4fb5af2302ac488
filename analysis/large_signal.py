"""Large-signal stability: in which range of speed errors the loop of a law with odd powers is stable.

The slope of such a law changes with the size of the speed error: it is steep at small errors, by |e2|^(2−p/q), and
again at large ones, by |e2|^(p/q). A loop that is stable at rest may therefore oscillate after a push, until the error
has faded; one that is unstable at rest may end in a cycle too small to matter.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from dualwinch.analysis.describing_function import AMPLITUDES, LARGEST_SPEED_ERROR, LoopByAmplitude
from dualwinch.analysis.linear_loop import closed, fastest_growing
from dualwinch.analysis.resonance import RULE_AMPLITUDES, THRESHOLD, ResonanceGain, largest_gain, resonance_gains
from dualwinch.model.arguments import one_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.modes import Mode
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.style import prefixed_unit

TOLERANCE = 1e-4
"""Relative tolerance of the amplitude."""


@dataclass(frozen=True)
class LargeSignalStability:
    """The range of speed errors in which a loop is stable, and the oscillation that ends it."""

    amplitude: Annotated[float, Quantity("m/s", "largest amplitude of the speed error up to which the loop is stable")]
    largest: Annotated[float, Quantity("m/s", "largest amplitude examined")]
    oscillation: Annotated[str, Quantity("", "what oscillates beyond; empty if the loop is stable throughout")]
    frequency: Annotated[float, Quantity("Hz", "frequency of that oscillation; NaN if there is none")]
    cycle: Annotated[
        float, Quantity("m/s", "speed amplitude of the limit cycle of a loop unstable at rest; NaN if there is none")
    ] = math.nan

    @property
    def throughout(self) -> bool:
        """Whether the loop is stable at all amplitudes examined."""
        return not self.oscillation

    def __str__(self) -> str:
        """The result in one line."""
        if self.throughout:
            return f"stable up to speed errors of {100 * self.largest:.3g} cm/s, the largest examined"
        limit = f"{self.oscillation} at {self.frequency:.3g} Hz"
        if not self.amplitude:
            return f"unstable already at the smallest speed errors: {limit}{self.cycle_words}"
        return f"stable up to speed errors of {100 * self.amplitude:.3g} cm/s; beyond, oscillation of {limit}"

    @property
    def cycle_words(self) -> str:
        """Size of the limit cycle in words, as the end of a sentence; empty if there is none."""
        if not math.isfinite(self.cycle):
            return ""
        unit, name = prefixed_unit("m", size := self.cycle / (2 * math.pi * self.frequency))
        return f"; it ends in a cycle of {size / unit:.2g} {name} and {1e3 * self.cycle:.2g} mm/s"


def large_signal_stability(
    experiment: Experiment, *, nominal: Plant | None = None, largest: float = LARGEST_SPEED_ERROR
) -> LargeSignalStability:
    """Range of speed errors in which the loop is stable, at rest at mid-track.

    1. The slopes of the law's odd powers are replaced by their describing functions (`describing_function`).
    2. Eigenvalues of the closed loop: the first of a grid of amplitudes, from 0.1 µm/s, at which a mode grows; then
       bisection.
    3. The same for the loop gain at the drums' resonances (`resonance`), from 0.1 mm/s, which must be below 1:
       mid-track, where both drums act together.
    4. The smaller amplitude of both counts.
    5. Of a loop with growing modes already at the smallest amplitude, the first amplitude without one: of that size is
       its stable limit cycle (Khalil, Nonlinear Systems, 2002, Section 7.2).

    Beyond saturation of the force the describing functions overestimate the gain of a single sinusoid, but not that of
    an oscillation about a large speed error that the law reduces at its own pace: there s is small, and so is the
    force.

    Args:
        experiment: plant, gains, sample time and delay.
        nominal: the plant the controller was designed for; default: the experiment's.
        largest: largest amplitude in m/s.

    Raises:
        ConfigurationError: a law without odd powers of the speed error, no steady motion at rest, or an amplitude
            that is not above 0.1 mm/s.

    Example:
        >>> import dualwinch as dw
        >>> print(dw.large_signal_stability(dw.case(4)))
        stable up to speed errors of 30 cm/s, the largest examined
    """
    smallest, largest = RULE_AMPLITUDES[0], one_number("largest", largest)
    if not smallest < largest < np.inf:
        raise ConfigurationError(f"largest = {largest:g}: must be a finite number > {smallest:g} m/s")
    of_rule = np.geomspace(smallest, largest, len(RULE_AMPLITUDES)).tolist()
    of_poles = [*(amplitude for amplitude in AMPLITUDES if amplitude < smallest), *of_rule]
    loop = LoopByAmplitude.of(experiment, None, 0.0, "u", nominal)

    def worst_drum(amplitude: float) -> ResonanceGain:
        return largest_gain(resonance_gains(experiment, nominal=nominal, amplitudes=[amplitude]))

    def growth(amplitude: float) -> Mode | None:
        return fastest_growing(closed(loop.at(amplitude)), experiment.plant)

    by_rule = _first(of_rule, lambda amplitude: worst_drum(amplitude).gain >= THRESHOLD)
    by_poles = _first(of_poles, lambda amplitude: growth(amplitude) is not None)
    limits = [amplitude for amplitude in (by_rule, by_poles) if amplitude is not None]
    if not limits:
        return LargeSignalStability(largest, largest, "", math.nan)
    limit, cycle = min(limits), math.nan
    if by_poles == of_poles[0]:
        cycle = _first(of_poles, lambda amplitude: growth(amplitude) is None) or math.nan
    mode = growth(cycle / (1 + TOLERANCE) if math.isfinite(cycle) else limit) if limit == by_poles else None
    if mode is None:
        drum = worst_drum(limit)
        oscillation, frequency = f"drum {drum.winch} on its rope", drum.frequency
    else:
        oscillation, frequency = mode.label, mode.natural_frequency / (2 * math.pi)
    amplitude = 0.0 if limit in (of_rule[0], of_poles[0]) else limit
    return LargeSignalStability(amplitude, largest, oscillation, frequency, cycle)


def _first(amplitudes: list[float], satisfied: Callable[[float], bool]) -> float | None:
    """The smallest amplitude that satisfies a condition: the first of a grid, then bisection; None: none of it does."""
    index = next((index for index, amplitude in enumerate(amplitudes) if satisfied(amplitude)), None)
    if not index:
        return None if index is None else amplitudes[0]
    low, high = amplitudes[index - 1], amplitudes[index]
    while high > low * (1 + TOLERANCE):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if satisfied(middle) else (middle, high)
    return high
