"""Describing functions of the odd powers: loop gain and margins against the amplitude of the speed error.

The sliding-mode law feeds back |e2|^(2−p/q), whose slope at zero would be infinite without smoothing, and |e2|^(p/q),
whose slope there is zero. A Jacobian contains only these slopes. For a speed error ``A sin(w t)`` the effective gain
is that of the first harmonic, the describing function; replacing the slope by it makes the loop linear for that
amplitude.
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
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

AMPLITUDES = tuple(float(amplitude) for amplitude in np.geomspace(1e-7, 1e-1, 25))
"""Default amplitudes of the speed error in m/s."""

PROBES = (1e-3, 1e-2, 1e-1)
"""Smoothings in m/s at which the loop is linearised, to separate the contributions of the two slopes."""


@dataclass(frozen=True)
class AmplitudePoint:
    """The loop for one amplitude of the speed error.

    Attributes:
        amplitude: of e2 in m/s.
        terminal_gain: describing function of sig(e2, 2 − p/q), over the smoothing's units (m/s)^(1−p/q).
        surface_gain: that of sig(e2, p/q), in (m/s)^(p/q−1).
        system: the opened loop.
        margins: its margins.
    """

    amplitude: float
    terminal_gain: float
    surface_gain: float
    system: LinearSystem
    margins: Margins


def describing_gain(amplitude: float | Floats, exponent: float | Floats, smoothing: float | Floats) -> Any:
    """First harmonic over amplitude of ``z (z² + eps²)^((a−1)/2)`` for ``z = A sin(w t)``: a real gain.

    It is ``eps^(a−1) 2F1((1−a)/2, 3/2; 2; −(A/eps)²)``: the slope at zero for small amplitudes, a constant times
    ``A^(a−1)`` for large ones. Amplitude A and smoothing eps are in the unit of z. Arguments may be arrays, which
    broadcast.
    """
    from scipy.special import hyp2f1

    size = (amplitude / smoothing) ** 2
    return smoothing ** (exponent - 1) * hyp2f1((1 - exponent) / 2, 1.5, 2.0, -size)


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
    """
    gains = sliding_mode(experiment, "has no odd power of the speed error; must be").nftsm
    for amplitude in amplitudes:
        if not 0 < amplitude < np.inf:
            raise ConfigurationError(f"amplitude = {amplitude:g}: must be a finite number > 0 m/s")
    ratio = gains.p / gains.q
    template, parts = _parts(experiment, x, v, opening)
    points = []
    for amplitude in amplitudes:
        terminal, surface = (float(describing_gain(amplitude, each, gains.smoothing)) for each in (2 - ratio, ratio))
        weights = np.array([1.0, terminal, surface])
        matrices = {name: np.tensordot(weights, part, axes=1) for name, part in parts.items()}
        system = without_idle_states(replace(template, **matrices))
        points.append(AmplitudePoint(amplitude, terminal, surface, system, margins(system)))
    return points


def _parts(experiment: Experiment, x: float | None, v: float, opening: str) -> tuple[LinearSystem, dict[str, Floats]]:
    """A system as template, and matrix name → (3, rows, columns): constant part, and contribution of each unit slope.

    The force is linear in both slopes and the rest is linear in the force, so that three linearisations determine the
    three parts exactly. The smoothing sets both slopes: eps^(1−p/q) and eps^(p/q−1).
    """
    law = sliding_mode(experiment)
    gains = law.nftsm
    power = gains.p / gains.q - 1
    systems = []
    for smoothing in PROBES:
        probed = replace(law, nftsm=replace(gains, smoothing=smoothing))
        controller = replace(experiment.controller, law=probed)
        systems.append(whole_open_loop(replace(experiment, controller=controller), x, v, opening))
    slopes = np.array([[1.0, smoothing**-power, smoothing**power] for smoothing in PROBES])
    shares = np.linalg.inv(slopes)
    return systems[0], {
        name: np.tensordot(shares, np.array([getattr(system, name) for system in systems]), axes=1)
        for name in ("A", "B", "C", "D")
    }
