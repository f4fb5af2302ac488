"""Describing functions of the odd powers: loop gain and margins against the amplitude of the speed error.

The sliding-mode law feeds back |e2|^(2−p/q), whose slope at zero would be infinite without smoothing, and |e2|^(p/q),
whose slope there is zero. A Jacobian contains only these slopes. For a speed error ``A sin(w t)`` the effective gain
is that of the first harmonic, the describing function; replacing the slope by it makes the loop linear for that
amplitude. That a widening boundary layer (`controllers.laws.nftsm`) divides the position error, too, is left out: in
oscillations as fast as those of drums on their ropes that error is small, and in slow ones of a large amplitude it is
beyond the layer, where describing functions of the speed error alone say nothing.

Reference: Khalil, Nonlinear Systems, 2002, Section 7.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.linear_loop import whole_open_loop, without_idle_states
from dualwinch.analysis.margins import Margins, margins
from dualwinch.analysis.stability import sliding_mode
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

LARGEST_SPEED_ERROR = 0.3
"""Largest amplitude of the speed error in m/s of default ranges: what a push leaves while the force is at its limit."""

AMPLITUDES = (*np.geomspace(1e-7, 1e-1, 25).tolist(), LARGEST_SPEED_ERROR)
"""Default amplitudes of the speed error in m/s."""

PROBES = (1e-3, 1e-2, 1e-1)
"""Smoothings in m/s at which the loop is linearised, to separate the contributions of the two slopes."""


@dataclass(frozen=True)
class DescribingGains:
    """Describing functions of the sliding-mode law for an amplitude of the speed error e2.

    Attributes:
        terminal: that of sig(e2, 2 − p/q), in (m/s)^(1−p/q).
        surface: that of sig(e2, p/q), over the layer's width if it widens, in (m/s)^(p/q−1).
    """

    terminal: Any
    surface: Any

    @classmethod
    def of(cls, amplitude: Any, ratio: Any, smoothing: Any, linear_speed: Any = 0.0) -> "DescribingGains":
        """The gains for an amplitude, smoothing and linear speed in m/s and a ratio p/q; arrays broadcast."""
        return cls(
            terminal=describing_gain(amplitude, 2 - ratio, smoothing),
            surface=describing_gain(amplitude, ratio, smoothing, linear_speed),
        )


@dataclass(frozen=True)
class AmplitudePoint:
    """The loop for one amplitude of the speed error.

    Attributes:
        amplitude: of e2 in m/s.
        gains: of the law.
        system: the opened loop.
        margins: its margins.
    """

    amplitude: float
    gains: DescribingGains
    system: LinearSystem
    margins: Margins


ANGLES = 256
"""Angles of the midpoint rule for describing functions, whose error falls faster than with their third power."""


def describing_gain(
    amplitude: float | Floats, exponent: float | Floats, smoothing: float | Floats, linear_speed: float | Floats = 0.0
) -> Any:
    """First harmonic over amplitude of ``z (z² + eps²)^((a−1)/2)`` for ``z = A sin(w t)``: a real gain.

    It is ``eps^(a−1) 2F1((1−a)/2, 3/2; 2; −(A/eps)²)``: the slope at zero for small amplitudes, a constant times
    ``A^(a−1)`` for large ones. Where the boundary layer widens (`controllers.laws.nftsm`), the power is divided by
    ``(1 + (z/v)²)^((a−1)/2)`` with the linear speed v > 0: the gain then tends to ``v^(a−1)``, by quadrature.
    Amplitude A, smoothing eps and v are in the unit of z. Arguments may be arrays, which broadcast.

    Example:
        >>> [f"{describing_gain(0.3, 5 / 3, 1e-5, speed):.3f}" for speed in (0.0, 0.01)]
        ['0.405', '0.046']
    """
    if np.any(linear_speed):
        return _widened_gain(amplitude, exponent, smoothing, linear_speed)
    from scipy.special import hyp2f1

    size = (amplitude / smoothing) ** 2
    return smoothing ** (exponent - 1) * hyp2f1((1 - exponent) / 2, 1.5, 2.0, -size)


def _widened_gain(amplitude: Any, exponent: Any, smoothing: Any, linear_speed: Any) -> Any:
    """`describing_gain` with a linear speed, by the midpoint rule over a quarter of a period."""
    square = np.sin((np.arange(ANGLES) + 0.5) * np.pi / (2 * ANGLES)) ** 2
    amplitude, exponent, smoothing, linear_speed = (
        np.asarray(value, float)[..., np.newaxis] for value in (amplitude, exponent, smoothing, linear_speed)
    )
    size = amplitude**2 * square
    slopes = ((size + smoothing**2) / (1 + size / linear_speed**2)) ** ((exponent - 1) / 2)
    return 2 * np.mean(square * slopes, axis=-1)


def amplitude_sweep(
    experiment: Experiment,
    x: float | None = None,
    v: float = 0.0,
    opening: str = "u",
    amplitudes: Sequence[float] = AMPLITUDES,
) -> list[AmplitudePoint]:
    """Gain and margins of the opened loop for amplitudes of the speed error.

    Exact for the law inside its boundary layer and without force saturation, except that describing functions neglect
    higher harmonics. The observer's gain is that of small errors, ``l0``.

    Args:
        experiment: plant, gains, sample time and delay.
        x: position in m; default: mid-track.
        v: speed in m/s.
        opening: where the loop is opened (see `analysis.linear_loop.linear_open_loop`).
        amplitudes: of e2 in m/s, > 0.

    Raises:
        ConfigurationError: a law without odd powers, an amplitude that is not positive, or no steady motion.

    Example:
        >>> import dualwinch as dw
        >>> [f"{point.margins.gain:.3g}" for point in dw.amplitude_sweep(dw.case(4), amplitudes=(1e-5, 1e-3))]
        ['6.4', '92.2']
    """
    for amplitude in amplitudes:
        if not 0 < amplitude < np.inf:
            raise ConfigurationError(f"amplitude = {amplitude:g}: must be a finite number > 0 m/s")
    loop, points = LoopByAmplitude.of(experiment, x, v, opening), []
    for amplitude in amplitudes:
        system = loop.at(amplitude)
        points.append(AmplitudePoint(amplitude, loop.gains(amplitude), system, margins(system)))
    return points


@dataclass(frozen=True)
class LoopByAmplitude:
    """An opened loop as a function of the amplitude of the speed error.

    The force is linear in both gains and the rest is linear in the force, so that three linearisations determine the
    constant part of the matrices and the parts that each of the gains contributes.

    Attributes:
        template: the system at one of the linearisations.
        parts: matrix name → (3, rows, columns): constant part, and contribution of each unit gain.
        ratio: p/q of the law.
        smoothing, linear_speed: in m/s.
    """

    template: LinearSystem
    parts: dict[str, Floats]
    ratio: float
    smoothing: float
    linear_speed: float

    @classmethod
    def of(
        cls, experiment: Experiment, x: float | None, v: float, opening: str, nominal: Plant | None = None
    ) -> "LoopByAmplitude":
        """The loop of an experiment; arguments as in `analysis.linear_loop.linear_open_loop`.

        Raises:
            ConfigurationError: a law without odd powers, an unknown opening, or no steady motion.
        """
        law = sliding_mode(experiment, "has no odd power of the speed error; must be")
        gains, power, systems = law.nftsm, law.nftsm.p / law.nftsm.q - 1, []
        for smoothing in PROBES:
            probe = replace(law, nftsm=replace(gains, smoothing=smoothing))
            controller = replace(experiment.controller, law=probe)
            systems.append(whole_open_loop(replace(experiment, controller=controller), x, v, opening, nominal))
        slopes = np.array([[1.0, smoothing**-power, smoothing**power] for smoothing in PROBES])
        shares = np.linalg.inv(slopes)
        parts = {
            name: np.tensordot(shares, np.array([getattr(system, name) for system in systems]), axes=1)
            for name in ("A", "B", "C", "D")
        }
        return cls(systems[0], parts, gains.p / gains.q, gains.smoothing, gains.linear_speed)

    def gains(self, amplitude: float) -> DescribingGains:
        """The law's gains at an amplitude in m/s."""
        return DescribingGains.of(amplitude, self.ratio, self.smoothing, self.linear_speed)

    def at(self, amplitude: float) -> LinearSystem:
        """The opened loop at an amplitude in m/s, without idle states."""
        gains = self.gains(amplitude)
        weights = np.array([1.0, gains.terminal, gains.surface], float)
        matrices = {name: np.tensordot(weights, part, axes=1) for name, part in self.parts.items()}
        return without_idle_states(replace(self.template, **matrices))
